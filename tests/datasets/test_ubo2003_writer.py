"""Datasets as UBO2003 zips, and back."""

import json
import os
import subprocess
import sys
import textwrap
import zipfile
from pathlib import Path

import numpy as np
import pytest

from addon.datasets.dataset import DatasetWriter, open_dataset
from addon.datasets.directions import spherical_to_unit
from addon.datasets.importing import import_dataset
from addon.datasets.ubo2003_writer import write_ubo2003
from addon.errors import Cancelled, NacreError

ROOT = Path(__file__).resolve().parents[2]
LIGHTS = ([0, 15, 15.4, 75], [0, 0, 60.3, 359.6])
VIEWS = ([0.2, 30, 60], [123, 90, 342])


def smooth_values(lights, views, height=16, width=24):
    """Values that JPEG codes well, in (0, 1]: no two images, colours, rows and columns alike."""
    light, view = np.arange(lights)[:, None, None, None], np.arange(views)[:, None, None]
    y, x = np.linspace(0, 1, height)[:, None], np.linspace(0, 1, width)
    level = 0.2 + 0.1 * light + 0.05 * view + 0.25 * y**2 + 0.1 * x
    return np.stack([level, level * 0.7, level * (0.4 + 0.3 * y)], axis=-1)


def make_dataset(folder, lights=LIGHTS, views=VIEWS, scale=1.0, dtype="<f4"):
    lights, views = spherical_to_unit(*lights), spherical_to_unit(*views)
    values = scale * smooth_values(len(lights), len(views))
    description = {
        "nacre": 1,
        "kind": "btf",
        "axes": ["light", "view", "y", "x", "channel"],
        "light": lights.tolist(),
        "view": views.tolist(),
        "channels": ["R", "G", "B"],
        "patch_size": [0.01, 0.01],
        "periodic": True,
        "noise_floor_db": None,
        "source": {},
    }
    with DatasetWriter(folder / "own.nacre", description, values.shape, dtype) as writer:
        writer.write(values)
    return open_dataset(folder / "own.nacre")


def test_round_trip(tmp_path):
    dataset = make_dataset(tmp_path)
    result = write_ubo2003(dataset, tmp_path / "own.zip")
    assert result["images"] == 12
    assert result["bytes"] == (tmp_path / "own.zip").stat().st_size
    assert result["clipped"] == 0
    assert 0.4 < result["rounded_degrees"] < 0.5
    back = import_dataset(tmp_path / "own.zip", tmp_path / "back.nacre")
    assert back.source["format"] == "ubo2003"
    # Sorted by (theta, phi), as whole degrees; the normal has no azimuth.
    np.testing.assert_allclose(back.light, spherical_to_unit([0, 15, 15, 75], [0, 0, 60, 0]))
    np.testing.assert_allclose(back.view, spherical_to_unit([0, 30, 60], [0, 90, 342]))
    encoded, expected = (np.asarray(d.samples, float) ** (1 / 2.2) for d in (back, dataset))
    assert np.abs(encoded - expected).max() < 4 / 255


def test_names_and_order(tmp_path):
    write_ubo2003(make_dataset(tmp_path), tmp_path / "own.zip")
    with zipfile.ZipFile(tmp_path / "own.zip") as archive:
        assert archive.testzip() is None
        names = archive.namelist()
    assert names[0] == "tv000_pv000/00000 tl000 pl000 tv000 pv000.jpg"
    assert names[1] == "tv030_pv090/00004 tl000 pl000 tv030 pv090.jpg"
    assert names[3] == "tv000_pv000/00001 tl015 pl000 tv000 pv000.jpg"
    assert len(set(names)) == 12


def test_white_divides_and_clips(tmp_path):
    dataset = make_dataset(tmp_path, scale=3.0)
    values = np.asarray(dataset.samples)
    result = write_ubo2003(dataset, tmp_path / "own.zip", white=2.0)
    assert result["clipped"] == pytest.approx((values > 2).mean())
    assert 0.01 < result["clipped"] < 0.9
    back = import_dataset(tmp_path / "own.zip", tmp_path / "back.nacre", white=0.5)
    encoded, expected = (
        v ** (1 / 2.2) for v in (np.asarray(back.samples, float), values.clip(0, 2))
    )
    assert np.abs(encoded - expected).max() < 0.05


def test_the_same_dataset_gives_the_same_bytes(tmp_path):
    dataset = make_dataset(tmp_path)
    for name in ("a.zip", "b.zip"):
        write_ubo2003(dataset, tmp_path / name)
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"lights": ([0, 15, 15.2], [0, 0, 0.3])}, "lights 1 and 2 are both theta 15 phi 0 in"),
        ({"views": ([0.3, 30, 0.4], [0, 9, 80])}, "views 0 and 2 are both theta 0 phi 0 in whole"),
    ],
)
def test_directions_that_whole_degrees_cannot_tell_apart(tmp_path, options, says):
    dataset = make_dataset(tmp_path, **options)
    with pytest.raises(NacreError, match=says):
        write_ubo2003(dataset, tmp_path / "own.zip")
    assert os.listdir(tmp_path) == ["own.nacre"]


def test_what_cannot_be_written(tmp_path):
    dataset = make_dataset(tmp_path)
    with pytest.raises(NacreError, match="white must be a number above 0, not 0"):
        write_ubo2003(dataset, tmp_path / "own.zip", white=0)
    with pytest.raises(NacreError, match="cannot write .*absent"):
        write_ubo2003(dataset, tmp_path / "absent" / "own.zip")
    with pytest.raises(NacreError, match="it is a folder"):
        write_ubo2003(dataset, tmp_path / "own.nacre")
    assert os.listdir(tmp_path) == ["own.nacre"]


def test_progress_and_cancelling(tmp_path):
    dataset = make_dataset(tmp_path)
    (tmp_path / "own.zip").write_bytes(b"older")
    calls = []
    with pytest.raises(Cancelled):
        write_ubo2003(dataset, tmp_path / "own.zip", progress=lambda done, _: done < 0.5)
    assert (tmp_path / "own.zip").read_bytes() == b"older"
    assert sorted(os.listdir(tmp_path)) == ["own.nacre", "own.zip"]
    write_ubo2003(
        dataset,
        tmp_path / "own.zip",
        progress=lambda done, text: calls.append((done, text)) or True,
    )
    fractions = [done for done, _ in calls]
    assert fractions[0] == 0
    assert fractions[-1] == 1
    assert fractions == sorted(fractions)
    assert all("own.nacre" in text for _, text in calls)


@pytest.mark.skipif(sys.platform == "win32", reason="needs a file-size limit")
def test_a_disk_that_fills_up(tmp_path):
    make_dataset(tmp_path)
    paths = str(tmp_path / "own.nacre"), str(tmp_path / "own.zip")
    script = f"""
        import resource, sys
        from addon.datasets.dataset import open_dataset
        from addon.datasets.ubo2003_writer import write_ubo2003
        from addon.errors import NacreError
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))
        try:
            write_ubo2003(open_dataset({paths[0]!r}), {paths[1]!r})
        except NacreError as error:
            sys.exit(str(error))
    """
    run = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)], cwd=ROOT, capture_output=True, text=True
    )
    assert run.returncode == 1
    assert run.stderr.count("\n") == 1
    assert "cannot write" in run.stderr
    assert os.listdir(tmp_path) == ["own.nacre"]


INDEPENDENT_READER = """
import json, sys
import numpy as np
from btf_extractor import Ubo2003
reader = Ubo2003(sys.argv[1])
images = {
    ",".join(map(str, angles)): reader.angles_to_image(*angles)[::-1, :, ::-1].tolist()
    for angles in sorted(reader.angles_set)
}
print(json.dumps(images))
"""


@pytest.mark.acceptance
def test_btf_extractor_reads_the_same(tmp_path):
    """Needs BTF_EXTRACTOR_PYTHON, the Python of an environment with btf-extractor 1.7.0, made as
    tests/fixtures/datasets/make_independent_values.py says."""
    python = os.environ.get("BTF_EXTRACTOR_PYTHON")
    if not python:
        pytest.skip("BTF_EXTRACTOR_PYTHON is not set")
    dataset = make_dataset(tmp_path)
    write_ubo2003(dataset, tmp_path / "own.zip")
    run = subprocess.run(
        [python, "-c", INDEPENDENT_READER, str(tmp_path / "own.zip")],
        capture_output=True,
        text=True,
        check=True,
    )
    images = {
        tuple(map(int, key.split(","))): np.array(v) for key, v in json.loads(run.stdout).items()
    }
    degrees = ((0, 0), (15, 0), (15, 60), (75, 0)), ((0, 0), (30, 90), (60, 342))
    assert set(images) == {(*light, *view) for light in degrees[0] for view in degrees[1]}
    back = import_dataset(tmp_path / "own.zip", tmp_path / "back.nacre")
    for i, light in enumerate(degrees[0]):
        for j, view in enumerate(degrees[1]):
            theirs = images[*light, *view]
            ours = np.rint(np.asarray(back.samples[i, j], float) ** (1 / 2.2) * 255)
            np.testing.assert_array_equal(ours, theirs)
            expected = np.asarray(dataset.samples[i, j], float) ** (1 / 2.2) * 255
            assert np.abs(theirs - expected).max() < 4
