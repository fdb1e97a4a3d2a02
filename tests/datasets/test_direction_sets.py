"""Named sets are those of the laboratories' own files."""

import os
from pathlib import Path

import numpy as np
import pytest

from addon.datasets import btf
from addon.datasets.direction_sets import direction_set, ubo_81
from addon.datasets.options import Options
from addon.errors import NacreError

ROOT = Path(__file__).resolve().parents[2]
SAMPLE = ROOT / "samples" / "wool_W64xH64_L81xV81.btf"


def test_ubo_81_is_the_order_of_a_bonn_file():
    source = btf.open_source(SAMPLE, Options())
    np.testing.assert_allclose(ubo_81(), source.light, atol=1e-6)
    np.testing.assert_allclose(ubo_81(), source.view, atol=1e-6)
    np.testing.assert_array_equal(direction_set("ubo81"), ubo_81())


def test_ubo_151_is_bonn_s_table():
    shared = Path(os.environ.get("NACRE_SHARED_DATA") or ROOT.parent / "shared" / "data")
    table = shared / "sparsebtf" / "bonn_angles.bin"
    if not table.is_file():
        pytest.skip("bonn_angles.bin is not in the folder NACRE_SHARED_DATA")
    azimuth, elevation, _ = np.fromfile(table, "<f8").reshape(3, 151)
    across = np.cos(elevation)
    expected = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), np.sin(elevation)], -1)
    np.testing.assert_allclose(direction_set("ubo151"), expected, atol=1e-5)


@pytest.mark.parametrize("count", [1, 2, 100, 1000])
def test_uniform_sets_are_even(count):
    found = direction_set(f"uniform:{count}")
    assert found.shape == (count, 3)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)
    np.testing.assert_allclose(found[0], (0, 0, 1))
    assert found[:, 2].min() > np.cos(np.radians(81))
    if count >= 100:  # neighbours are as far as the area of the cap lets them be
        nearest = np.sort(np.degrees(np.arccos(np.clip(found @ found.T, -1, 1))), axis=1)[:, 1]
        share = np.degrees(np.sqrt(2 * np.pi * (1 - np.cos(np.radians(80))) / count))
        assert 0.5 * share < nearest.min() <= nearest.max() < 1.2 * share


def test_a_csv_file_is_a_set(tmp_path):
    (tmp_path / "own.csv").write_text("theta,phi\n0,0\n45,90\n")
    found = direction_set(str(tmp_path / "own.csv"))
    np.testing.assert_allclose(found, [[0, 0, 1], [0, 0.5**0.5, 0.5**0.5]], atol=1e-12)


@pytest.mark.parametrize("name", ["ubo", "uniform:0", "uniform:x", "uniform", "uniform:99999"])
def test_mistakes(name):
    with pytest.raises(NacreError, match=f"directions '{name}': expected"):
        direction_set(name)
