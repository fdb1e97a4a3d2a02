"""Coverage of open meso-structure, seen from several directions."""

from __future__ import annotations

import numpy as np
import pytest

from addon.datasets.directions import spherical_to_unit
from addon.measure.occlusion import coverage, measure_occlusion
from addon.measure.tiles import Tiles

WHITE = (1, 1, 1)


def test_mask_moves_with_the_view_and_wraps(make_patch):
    patch = make_patch(((-0.5, 0), (-0.25, 0.25), 0.25, WHITE))
    mask = coverage(patch, spherical_to_unit([0, 45, 45], [0, 0, 270]), (4, 4))
    assert mask.shape == (3, 4, 4)
    assert set(np.unique(mask)) == {0.0, 1.0}
    found = [np.argwhere(covered).tolist() for covered in mask]
    assert found == [[[2, 0]], [[2, 3]], [[3, 0]]]


def test_mean_coverage(make_patch):
    patch = make_patch(((-0.5, -0.5), (-0.125, 0.5), 0, WHITE))
    covered = coverage(patch, spherical_to_unit([30], [70]), (2, 2), samples=64)
    np.testing.assert_allclose(covered[0], [[0.75, 0], [0.75, 0]], atol=0.05)


@pytest.mark.parametrize("value", ["mask", "signed-distance"])
def test_dataset(tmp_path, make_patch, value):
    patch = make_patch(((-0.5, 0), (-0.25, 0.5), 0, WHITE))
    view = spherical_to_unit([0, 45], [0, 0])
    dataset = measure_occlusion(patch, tmp_path / "a.nacre", view, width=8, value=value)
    assert (dataset.kind, dataset.value, dataset.shape) == ("occlusion", value, (2, 8, 8))
    covered = np.zeros((8, 8), bool)
    covered[4:, :2] = True
    np.testing.assert_array_equal(dataset.samples > (0.5 if value == "mask" else 0), [covered] * 2)
    assert dataset.samples.min() == (0 if value == "mask" else -1)


@pytest.mark.parametrize(("count", "size"), [(1, (6, 6)), (5, (9, 6)), (81, (27, 27))])
def test_tiles(count, size):
    tiles = Tiles(count, (3, 3))
    assert tiles.picture_size == size
    picture = np.zeros((size[1], size[0], 1))
    for number in range(count):
        row, column = divmod(number, tiles.columns)
        picture[3 * row : 3 * row + 3, 3 * column : 3 * column + 3] = number
        picture[3 * row, 3 * column + 1] = -number
    split = tiles.split(picture)
    assert split.shape == (count, 3, 3, 1)
    np.testing.assert_array_equal(split[:, 2, 2, 0], np.arange(count))
    np.testing.assert_array_equal(split[:, 0, 1, 0], -np.arange(count))


def test_tiles_that_are_not_square():
    tiles = Tiles(2, (3, 2))
    assert tiles.picture_size == (6, 4)
    picture = np.arange(24.0).reshape(4, 6, 1)
    np.testing.assert_array_equal(tiles.split(picture)[1, ..., 0], [[3, 4, 5], [9, 10, 11]])
