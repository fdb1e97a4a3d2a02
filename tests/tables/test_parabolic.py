import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.tables.parabolic import texel_directions, texel_of

SIZES = pytest.mark.parametrize("size", [4, 6, 64, 256])


def coordinates(size):
    """p (size, size, 2) of each texel, row = y: the unit disc is the hemisphere."""
    steps = (np.arange(size) - size // 2) / (size // 2 - 1)
    return np.stack(np.meshgrid(steps, steps), -1)


@SIZES
def test_texels_stand_for_unit_directions_above_the_surface(size):
    directions = texel_directions(size)
    assert directions.shape == (size, size, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0)
    assert directions[..., 2].min() > -1e-12


@SIZES
def test_the_map_is_the_parabolic_one(size):
    """p = (x, y) / (1 + z)."""
    p = coordinates(size)
    inside = np.linalg.norm(p, axis=-1) <= 1.0
    x, y, z = np.moveaxis(texel_directions(size), -1, 0)
    np.testing.assert_allclose((x / (1 + z))[inside], p[..., 0][inside], atol=1e-12)
    np.testing.assert_allclose((y / (1 + z))[inside], p[..., 1][inside], atol=1e-12)


@SIZES
def test_texels_outside_the_disc_stand_for_its_rim(size):
    p = coordinates(size)
    reach = np.linalg.norm(p, axis=-1)
    outside = reach > 1.0
    assert outside.any()
    directions = texel_directions(size)[outside]
    np.testing.assert_allclose(directions[:, 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(directions[:, :2], p[outside] / reach[outside][:, None])


@SIZES
def test_a_texel_is_nearest_to_its_own_direction(size):
    inside = np.linalg.norm(coordinates(size), axis=-1) <= 1.0
    rows, columns = np.nonzero(inside)
    found = texel_of(texel_directions(size)[inside], size)
    np.testing.assert_array_equal(found, np.stack([columns, rows], -1))


@SIZES
def test_the_normal_is_in_the_middle_of_a_texel(size):
    np.testing.assert_array_equal(texel_directions(size)[size // 2, size // 2], [0, 0, 1])
    nearly = 0.4 / (size // 2 - 1)
    for p in ((0, 0), (nearly, 0), (-nearly, 0), (0, nearly), (0, -nearly)):
        square = np.dot(p, p)
        direction = np.array([2 * p[0], 2 * p[1], 1 - square]) / (1 + square)
        assert texel_of(direction, size).tolist() == [size // 2, size // 2]


@settings(max_examples=200, deadline=None, derandomize=True)
@given(
    st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3),
    st.integers(2, 40).map(lambda n: 2 * n),
)
def test_any_direction_has_a_texel(vector, size):
    direction = np.array(vector) / np.linalg.norm(vector)
    column, row = texel_of(direction, size)
    assert 0 <= column < size and 0 <= row < size
    found = texel_directions(size)[row, column]
    seen = direction.copy()
    if seen[2] < 0:  # below the horizon: the rim in the same azimuth
        reach = np.hypot(*seen[:2])
        if reach < 1e-3:
            return
        seen = np.array([*seen[:2] / reach, 0.0])
    # Half a texel's diagonal; a step in p is at most twice as long on the sphere.
    assert np.linalg.norm(found - seen) <= 2 * np.sqrt(0.5) / (size // 2 - 1) + 1e-9


def test_directions_of_any_shape():
    directions = texel_directions(8)
    np.testing.assert_array_equal(
        texel_of(directions, 8), texel_of(directions.reshape(-1, 3), 8).reshape(8, 8, 2)
    )
