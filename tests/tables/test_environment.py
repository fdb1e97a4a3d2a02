"""The light basis convolved with environments, against integration and against closed forms."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from small_btf import hemisphere, make_model

from addon.errors import NacreError
from addon.tables.environment import (
    build_environment,
    environment_vectors,
    evaluate_environment,
    integrate_environment,
    integrated_points,
)
from addon.tables.evaluate import evaluate_points
from addon.tables.light_lobes import light_lobes
from addon.tables.orientations import corners_of, grid_frames
from addon.tables.parabolic import texel_directions
from addon.tables.tables import Tables, build_tables, quads
from addon.tables.world_picture import (
    filter_picture,
    picture_directions,
    pixel_of,
    resize_picture,
    solid_angles,
)

SHAPE = (12, 14, 5, 6, 3)
GRID = 17
KINDS = {
    "nsvd": {"ranks": (5, 6, 3, 3)},
    "kcta": {
        "ranks": (6, 3, 2, 3),
        "clusters": {"view": 4},
        "mixtures": {"view": 2},
        "shared": ("light",),
    },
    "mkcta": {
        "ranks": (3, 2, 3, 3),
        "clusters": {"light": 3, "view": 2},
        "mixtures": {"light": 2, "view": 2},
        "shared": ("y", "x"),
    },
}


def frames_of(count, seed=0):
    """Random frames, every third one left-handed."""
    rng = np.random.default_rng(seed)
    frames = np.linalg.qr(rng.standard_normal((count, 3, 3)))[0]
    left = np.linalg.det(frames) < 0
    frames[left != (np.arange(count) % 3 == 0), 1] *= -1
    return frames


def turned_about_z(degrees):
    turn = np.radians(degrees)
    return np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])


def diffuse_tables(size=64):
    """Tables of a white diffuser: one light row, the cosine, the same in each channel."""
    cosine = np.maximum(texel_directions(size)[..., 2], 0.0)
    index = np.zeros((1, size, size), np.uint32)
    return Tables(
        core=quads(np.ones((1, 1, 1, 1, 2, 2, 1)))[..., 0, :],
        light=quads(np.tile(cosine[..., None], (1, 3, 1, 1, 1, 1, 1)))[..., 0, :],
        view=quads(np.ones((1, 1, 1, size, size, 1)))[..., 0, :],
        light_index=index,
        view_index=index,
    )


def world_picture(height=64, width=128, seed=0):
    """An environment without symmetry: a sky, a coloured band and a small sun."""
    directions = picture_directions(height, width)
    x, y, z = np.moveaxis(directions, -1, 0)
    sun = 60.0 * np.exp(80.0 * (directions @ [0.48, -0.6, 0.64] - 1.0))
    red = 0.5 + 0.4 * x + 0.3 * y * z + sun
    green = 0.6 + 0.3 * z - 0.2 * x * y + 0.8 * sun
    blue = 0.7 + 0.4 * y + 0.2 * np.sin(3 * x + z) + 0.5 * sun
    return np.stack([red, green, blue], -1)


@lru_cache
def tables_of(kind):
    return build_tables(make_model(SHAPE, **KINDS[kind]), size=32)


def relative(found, expected):
    return np.sqrt(np.mean((found - expected) ** 2) / np.mean(expected**2))


@pytest.mark.parametrize("size", [(4, 8), (90, 180)])
def test_a_pixel_is_found_by_its_direction(size):
    directions = picture_directions(*size)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0)
    assert (pixel_of(directions, *size).ravel() == np.arange(size[0] * size[1])).all()


def test_a_picture_is_mapped_as_in_blender():
    """+x in the middle, +y a quarter to the left, +z in the last row, which is the top."""
    found = pixel_of(np.array([[1, 1e-3, 0.01], [0, 1, 0.01], [0, -1, 0.01], [0.1, 0, 1]]), 8, 16)
    assert found.tolist() == [4 * 16 + 7, 4 * 16 + 4, 4 * 16 + 12, 7 * 16 + 8]


def test_solid_angles_fill_the_sphere():
    assert 180 * solid_angles(90, 180).sum() == pytest.approx(4 * np.pi)


@pytest.mark.parametrize("size", [(16, 32), (30, 50), (200, 260)])
def test_resizing_keeps_the_energy(size):
    picture = np.random.default_rng(0).random((60, 100, 3)) ** 8
    resized = resize_picture(picture, *size)

    def energy(p):
        return (p * solid_angles(*p.shape[:2])[:, None, None]).sum((0, 1))

    np.testing.assert_allclose(energy(resized), energy(picture))


def test_filtering_is_the_integral_with_a_lobe():
    picture = world_picture(16, 32)
    directions = picture_directions(16, 32).reshape(-1, 3)
    lobes = np.exp(5.0 * (directions @ directions.T - 1.0))
    power = (picture * solid_angles(16, 32)[:, None, None]).reshape(-1, 3)
    np.testing.assert_allclose(filter_picture(picture, 5.0).reshape(-1, 3), lobes @ power)


@pytest.mark.parametrize("grid", [5, 9])
def test_a_grid_frame_is_found_at_its_own_point(grid):
    frames = grid_frames(grid)
    np.testing.assert_allclose(frames @ np.swapaxes(frames, -1, -2) - np.eye(3), 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)
    inside = np.stack(np.meshgrid(*[np.arange(1, grid - 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    mirrored = np.array([1, -1, 1])[:, None]
    for hand, flip in enumerate((1.0, mirrored)):
        for turn, signs in enumerate(([1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1])):
            corners = corners_of(frames[tuple(inside.T)] * signs * flip, grid)
            found = sum(corner[0][:, None] * np.column_stack(corner[3:]) for corner in corners)
            np.testing.assert_allclose(found, inside, atol=1e-9)
            assert (corners[0][1] == hand).all() and (corners[0][2] == turn).all()


def test_neighbouring_frames_have_neighbouring_vectors():
    """Across faces of cells and of cubes: no seam anywhere on the way round."""
    grid, lobes = 13, light_lobes(diffuse_tables())
    table = build_environment(lobes, world_picture(), grid)
    turns = np.linspace(0, 2 * np.pi, 4001)[:, None, None]
    for start, axis in zip(frames_of(6, 3), frames_of(6, 4)[:, 0], strict=True):
        cross = np.cross(np.eye(3), axis)
        path = np.eye(3) + np.sin(turns) * cross + (1 - np.cos(turns)) * (cross @ cross)
        vectors = environment_vectors(table, start @ path)[:, 0, :, 0, 0]
        assert 0 < np.abs(np.diff(vectors, axis=0)).max() < 0.003 * np.ptp(vectors)


def test_a_white_diffuser_in_a_uniform_world_is_as_bright():
    """The furnace: all of the light comes back, in any orientation."""
    picture = np.broadcast_to([0.2, 1.0, 3.0], (32, 64, 3))
    table = build_environment(light_lobes(diffuse_tables()), picture, GRID)
    frames = frames_of(50)
    found = evaluate_environment(
        diffuse_tables(), table, frames, np.tile([0, 0, 1.0], (50, 1)), np.zeros((50, 2))
    )
    np.testing.assert_allclose(found, np.tile([0.2, 1.0, 3.0], (50, 1)), rtol=0.01)


def test_a_white_diffuser_sees_the_side_it_faces():
    """L = 1 + omega . a gives 1 + 2/3 normal . a."""
    axis = np.array([0.3, -0.5, 0.4])
    picture = np.repeat(1.0 + (picture_directions(64, 128) @ axis)[..., None], 3, -1)
    table = build_environment(light_lobes(diffuse_tables()), picture, GRID)
    frames = frames_of(200)
    found = environment_vectors(table, frames)[:, 0, 0, 0, 0]
    np.testing.assert_allclose(found, 1.0 + 2.0 / 3.0 * frames[:, 2] @ axis, rtol=0.01)


@pytest.mark.parametrize("kind", KINDS)
def test_vectors_are_those_of_the_integral(kind):
    tables, frames = tables_of(kind), frames_of(40)
    table = build_environment(light_lobes(tables), world_picture(), GRID)
    expected = integrate_environment(tables, world_picture(), frames)
    assert relative(environment_vectors(table, frames), expected) < 0.05


@pytest.mark.parametrize("kind", KINDS)
def test_the_integral_is_the_sum_over_lights(kind):
    """integrate_environment and reduced_points against evaluate_points, light by light."""
    tables = tables_of(kind)
    rng = np.random.default_rng(2)
    frames, view, uv = frames_of(4), hemisphere(8)[1:5], rng.random((4, 2))
    picture = world_picture(24, 48)
    # Negative light leaves what is clamped at 0 out of both: lift every value above it.
    directions = picture_directions(24, 48).reshape(-1, 3)
    power = (picture * solid_angles(24, 48)[:, None, None]).reshape(-1, 3) / np.pi
    lifted = replace(tables, light=np.abs(tables.light), core=np.abs(tables.core),
                     view=np.abs(tables.view))  # fmt: skip
    expected = []
    for frame, v, at in zip(frames, view, uv, strict=True):
        lights = directions @ frame.T
        many = [np.tile(a, (len(lights), 1)) for a in (v, at)]
        expected.append((power * evaluate_points(lifted, lights, *many)).sum(0))
    found = integrated_points(lifted, picture, frames, view, uv)
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_turning_the_world_turns_only_the_frames():
    """A picture moved to the left is a world turned from x to y; the table stays."""
    tables, frames = tables_of("kcta"), frames_of(60)
    picture = world_picture()
    turned = np.roll(picture, -picture.shape[1] // 4, 1)  # by a quarter
    into_world = frames @ turned_about_z(90)  # each axis turned back by a quarter
    table = build_environment(light_lobes(tables), picture, GRID)
    found = environment_vectors(table, into_world)
    expected = integrate_environment(tables, turned, frames)
    assert relative(found, expected) < 0.05
    unturned = environment_vectors(table, frames)
    assert relative(unturned, expected) > 0.2


def test_radiance_of_points():
    tables = tables_of("mkcta")
    rng = np.random.default_rng(4)
    frames, uv = frames_of(60), rng.random((60, 2))
    view = hemisphere(60)
    table = build_environment(light_lobes(tables), world_picture(), GRID)
    found = evaluate_environment(tables, table, frames, view, uv)
    expected = integrated_points(tables, world_picture(), frames, view, uv)
    assert found.shape == (60, 3) and (found >= 0).all() and expected.mean() > 0.1
    assert relative(found, expected) < 0.05


def test_grey_models_take_coloured_light():
    model = make_model((12, 14, 5, 6, 1), **KINDS["kcta"])
    tables = build_tables(model, size=32)
    frames = frames_of(20)
    table = build_environment(light_lobes(tables), world_picture(), GRID)
    expected = integrate_environment(tables, world_picture(), frames)
    assert expected.shape[2] == 3
    assert relative(environment_vectors(table, frames), expected) < 0.05


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_an_environment_that_is_not_finite(value):
    picture = world_picture(8, 16)
    picture[3, 4, 1] = value
    with pytest.raises(NacreError, match="finite") as caught:
        build_environment(light_lobes(diffuse_tables()), picture)
    assert "\n" not in str(caught.value)


def test_a_table_is_a_picture_of_some_megabytes():
    table = build_environment(light_lobes(tables_of("kcta")), world_picture())
    owners, channels, clusters, light_quads = table.vectors.shape[:4]
    assert (owners, channels, clusters, light_quads) == (1, 3, 1, 2)
    assert table.vectors.shape[4:] == (2, 4, 25, 25, 25, 4)
    assert table.vectors.dtype == np.float16 and table.vectors.nbytes < 7e6
    assert np.abs(table.vectors).max() == pytest.approx(1.0)
