"""Levels of the core: averages of the patch, and borders that repeat its other side."""

from __future__ import annotations

import numpy as np
import pytest

from addon.tables.levels import (
    count_beside,
    halve,
    layers_of_levels,
    levels_beside,
    regions,
)


@pytest.mark.parametrize("shape", [(8, 8), (12, 10), (7, 5), (1, 6), (1, 1)])
def test_every_level_has_the_mean_of_the_patch(shape):
    core = np.random.default_rng(0).random((2, 3, *shape, 4), np.float32)
    layers = layers_of_levels(core)
    layout = regions(*shape)
    assert layers.shape == (6, *layout.shape, 4)
    assert layout.places[-1][2:] == (1, 1)
    for x, y, wide, high in layout.places:
        region = layers[:, y : y + high, x : x + wide]
        np.testing.assert_allclose(
            region.mean((1, 2)), core.reshape(6, *shape, 4).mean((1, 2)), atol=1e-6
        )


def test_halves_are_boxes_of_two():
    texels = np.arange(6, dtype=np.float32).reshape(1, 6)
    np.testing.assert_allclose(halve(texels, 1), [[0.5, 2.5, 4.5]])


def test_odd_sizes_take_parts_of_texels():
    texels = np.array([[1.0, 0.0, 0.0, 0.0, 0.0]], np.float32)
    np.testing.assert_allclose(halve(texels, 1), [[0.4, 0.0]], atol=1e-7)


def test_borders_repeat_the_other_side():
    core = np.random.default_rng(1).random((1, 6, 4, 4), np.float32)
    layers = layers_of_levels(core)
    for x, y, wide, high in regions(6, 4).places:
        inside = layers[0, y : y + high, x : x + wide]
        bordered = layers[0, y - 1 : y + high + 1, x - 1 : x + wide + 1]
        np.testing.assert_array_equal(bordered, np.pad(inside, ((1, 1), (1, 1), (0, 0)), "wrap"))


def test_regions_do_not_overlap():
    layout = regions(9, 16)
    used = np.zeros(layout.shape, int)
    for x, y, wide, high in layout.places:
        used[y - 1 : y + high + 1, x - 1 : x + wide + 1] += 1
    assert used.max() == 1


def test_halved_copies_beside_the_core() -> None:
    """Each where a shader looks for it, with the mean of the whole, and none over another."""
    core = np.random.default_rng(0).random((2, 13, 6, 4)).astype(np.float32) + 1.0
    beside = levels_beside(core)
    assert beside.shape == (2, 13, 9, 4) and count_beside(13, 6) == 2
    np.testing.assert_array_equal(beside[:, :, :6], core)
    np.testing.assert_allclose(beside[:, :6, 6:9], halve(halve(core, 1), 2))
    last = beside[:, 6:9, 6:7]  # 3 x 1 texels from row floor(13 / 2)
    np.testing.assert_allclose(last.mean((1, 2)), core.mean((1, 2)), rtol=1e-5)
    assert not beside[:, 9:, 6:].any() and not beside[:, 6:, 7:].any()
