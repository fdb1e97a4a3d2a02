"""A dataset to a file of other programs and back."""

import numpy as np
import pytest

from addon.datasets.dataset import open_dataset


@pytest.mark.parametrize(
    ("name", "options", "format"),
    [
        ("a.btf", (), "btf"),
        ("a.BTF", ("--components", 80, "--colour", "log"), "btf"),
        ("a.bin", ("--format", "btf"), "btf"),
        ("a.zip", (), "ubo2003"),
    ],
)
def test_export_and_import(nacre_json, tmp_path, small, name, options, format):
    said = nacre_json("export", "small.nacre", tmp_path / name, *options)
    assert (said["what"], said["format"]) == ("measured file", format)
    assert said["bytes"] == (tmp_path / name).stat().st_size
    info = nacre_json("info", tmp_path / name)
    assert info["format"] == format
    assert info["bytes"] == said["bytes"]
    nacre_json("import", tmp_path / name, tmp_path / "back.nacre")
    back = open_dataset(tmp_path / "back.nacre")
    # JPEG on the one hand, half floats and values below 0 on the other.
    expected = np.clip(small.samples, 0, 1) if format == "ubo2003" else np.asarray(small.samples)
    error = np.abs(back.samples - expected).mean() / np.abs(expected).mean()
    assert error < (0.1 if format == "ubo2003" else 0.01)


def test_components(nacre_json, tmp_path):
    few, more = (
        nacre_json("export", "small.nacre", tmp_path / "a.btf", "--components", count)
        for count in (2, 20)
    )
    assert few["components"] == [2, 2, 2]
    assert nacre_json("info", tmp_path / "a.btf")["components"] == more["components"] == [20] * 3
    assert few["bytes"] < more["bytes"]
    assert few["snr_db"] < more["snr_db"]


def test_colour(nacre_json, tmp_path):
    nacre_json("export", "small.nacre", tmp_path / "a.btf", "--colour", "log")
    assert nacre_json("info", tmp_path / "a.btf")["colour_model"] == "11 (log Y, U/Y, V/Y)"
