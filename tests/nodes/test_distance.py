"""Materials whose texels are smaller than pixels: the level that is read, against the CPU."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import atan, cos, log2, radians

import bpy
import numpy as np
import pytest

from addon.models.clustered_tucker import ClusteredTucker
from addon.nodes.footprint import level_group
from addon.nodes.graph import Graph
from addon.nodes.material import material_from_tables, set_coordinates, set_lights
from addon.render.engines import NODE_ENGINES, render_pixels, set_engine
from addon.render.stage import add_camera, add_mesh, add_sun, new_scene, unit
from addon.tables.evaluate import evaluate_points
from addon.tables.tables import Tables, build_tables

PIXELS, SPAN = 24, 0.6
VIEW, LIGHT = (40.0, 320.0), (40.0, 200.0)


@pytest.fixture(scope="module")
def fine(make_model: Callable[..., ClusteredTucker]) -> Tables:
    """A patch that halves to whole texels; positive, since what is clamped does not average."""
    tables = build_tables(make_model(texels=(16, 8), ranks=(6, 3, 16, 8)), size=64)
    positive = {part: np.abs(getattr(tables, part)) for part in ("core", "light", "view")}
    return replace(tables, **positive)


def _plane(scene: bpy.types.Scene, material: bpy.types.Material, repeat: float) -> None:
    plane = add_mesh(scene, "plane", material)
    for corner in plane.data.uv_layers.active.uv:
        corner.vector = [repeat * (value - 0.5) for value in corner.vector]


def _seen(material: bpy.types.Material, repeat: float, engine: str = "eevee") -> np.ndarray:
    """One sample in each pixel's middle."""
    with new_scene((PIXELS, PIXELS)) as scene:
        _plane(scene, material, repeat)
        add_camera(scene, VIEW, SPAN)
        add_sun(scene, LIGHT).data.use_shadow = False
        set_lights(material, scene)
        set_engine(scene, engine, 1)
        scene.eevee.use_shadows = False  # whose maps take longer than the picture
        scene.render.filter_size = 0.0
        scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
        return render_pixels(scene)


def _truth(tables: Tables, repeat: float, over: int) -> np.ndarray:
    """The mean of over x over points in each pixel."""
    steps = SPAN * ((np.arange(over * PIXELS) + 0.5) / (over * PIXELS) - 0.5)
    towards = unit(VIEW)
    right = np.cross((0.0, 0.0, 1.0), towards)
    right /= np.linalg.norm(right)
    up = np.cross(towards, right)
    origin = steps[None, :, None] * right + steps[:, None, None] * up
    hit = (origin - towards * (origin[..., 2:] / towards[2])).reshape(-1, 3)
    lights, views = (np.tile(unit(d), (len(hit), 1)) for d in (LIGHT, VIEW))
    values = evaluate_points(tables, lights, views, repeat * hit[:, :2])
    return values.reshape(PIXELS, over, PIXELS, over, 3).mean((1, 3))


@pytest.mark.parametrize("engine", NODE_ENGINES)
def test_far_picture_is_nearer_to_the_truth(engine: str, fine: Tables) -> None:
    """About 3 x 5 texels a pixel: half the error of a texture without levels at the most."""
    repeat = 14.0
    truth = _truth(fine, repeat, 10)
    without = np.abs(_truth(fine, repeat, 1) - truth).mean()
    seen = _seen(material_from_tables(fine, "Test"), repeat, engine)
    assert without > 0.1 * truth.mean()
    assert np.abs(seen - truth).mean() < 0.5 * without


def test_near_picture_reads_the_texels_themselves(fine: Tables) -> None:
    seen = _seen(material_from_tables(fine, "Test"), 2.0)
    expected = _truth(fine, 2.0, 1)
    assert np.abs(seen - expected).mean() < 0.01 * expected.mean()


def test_a_map_of_coordinates_has_levels_too(fine: Tables) -> None:
    """A map that lays two patches beside each other changes nothing."""
    material = material_from_tables(fine, "Test")
    plain = _seen(material, 14.0)
    rows, columns = np.indices((32, 16))
    set_coordinates(material, np.stack([rows % 16, columns % 8], -1))
    np.testing.assert_allclose(_seen(material, 14.0), plain, atol=0.01 * plain.max())


@pytest.mark.parametrize(("tilt", "perspective"), [(0.0, False), (40.0, True), (75.0, False)])
def test_level_is_that_of_the_longer_side(tilt: float, perspective: bool) -> None:
    material = bpy.data.materials.new("Level")
    if material.node_tree is None:
        material.use_nodes = True
    material.node_tree.nodes.clear()
    g = Graph(material.node_tree)
    node = g.node("ShaderNodeGroup", g.wire(g.node("ShaderNodeUVMap")), node_tree=level_group())
    g.node("ShaderNodeOutputMaterial", g.wire(g.node("ShaderNodeEmission", g.wire(node))))
    repeat = 4000.0
    with new_scene((48, 32)) as scene:
        _plane(scene, material, repeat)
        camera = add_camera(scene, (tilt, 30.0), 0.2)
        if perspective:
            camera.data.type, camera.data.angle = "PERSP", 2.0 * atan(0.1 / 10.0)
        set_engine(scene, "eevee", 1)
        scene.eevee.use_shadows = False
        scene.render.filter_size = 0.0
        seen = render_pixels(scene)[12:20, 20:28, 0]
    expected = log2(repeat * 0.2 / 48 / cos(radians(tilt)))
    assert np.abs(seen - expected).max() < 0.03
