"""The lights of a scene against Blender's own lights on a white diffuser."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

import bpy
import numpy as np
import pytest
from mathutils import Euler

from addon.nodes.graph import Graph, Wire
from addon.nodes.light_set import bring_up_to_date, count_of, light_set, shining
from addon.render.engines import render_pixels, set_engine
from addon.render.stage import add_camera, add_mesh, new_scene


def _material(name: str) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material


def _white() -> bpy.types.Material:
    material = _material("White")
    g = Graph(material.node_tree)
    diffuse = g.node("ShaderNodeBsdfDiffuse", (1.0, 1.0, 1.0, 1.0))
    g.node("ShaderNodeOutputMaterial", g.wire(diffuse))
    return material


def _from_set(scene: bpy.types.Scene) -> bpy.types.Material:
    """Emission of the lights' radiances times their cosines, which is a white diffuser."""
    material = _material("Set")
    g = Graph(material.node_tree)
    node = g.node("ShaderNodeGroup", node_tree=light_set(scene))
    normal = g.wire(g.node("ShaderNodeNewGeometry"), "Normal")
    total = g.combine(0.0, 0.0, 0.0)
    outputs = list(node.outputs)
    for direction, radiance in zip(outputs[::2], outputs[1::2], strict=True):
        cosine = g.math("MAXIMUM", g.dot(normal, Wire(g, direction)), 0.0)
        total = total + Wire(g, radiance) * cosine
    emission = g.node("ShaderNodeEmission", total)
    g.node("ShaderNodeOutputMaterial", g.wire(emission))
    return material


@pytest.fixture
def scene() -> Iterator[bpy.types.Scene]:
    with new_scene((24, 24)) as made:
        add_camera(made, (0.0, 0.0), 1.0)
        made.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
        set_engine(made, "cycles", 4)
        made.cycles.max_bounces = 0
        yield made


def _light(scene: bpy.types.Scene, kind: str) -> bpy.types.Object:
    data = bpy.data.lights.new(kind, kind)
    data.color = (0.9, 0.5, 0.2)
    if kind == "SUN":
        data.energy, data.angle = 2.5, 0.0
    else:
        data.energy = 70.0
    if kind in ("POINT", "SPOT"):
        data.shadow_soft_size = 0.0
    if kind == "AREA":
        data.shape, data.size, data.size_y = "RECTANGLE", 0.3, 0.1
    if kind == "SPOT":
        data.spot_size, data.spot_blend = 0.5, 0.4
    # A parent, so that what is driven must be the world's transform and not the object's own.
    parent = bpy.data.objects.new("Parent", None)
    parent.rotation_euler = (0.2, -0.1, 0.4)
    item = bpy.data.objects.new(kind, data)
    item.parent = parent
    item.location = (0.5, 0.3, 1.6)
    item.rotation_euler = Euler((-0.2, 0.3, 0.1))
    for made in (parent, item):
        scene.collection.objects.link(made)
    return item


def _render_both(scene: bpy.types.Scene) -> tuple[np.ndarray, np.ndarray]:
    plane = add_mesh(scene, "plane", _white())
    expected = render_pixels(scene)
    plane.data.materials[0] = _from_set(scene)
    return render_pixels(scene), expected


@pytest.mark.parametrize("kind", ["SUN", "POINT", "SPOT", "AREA"])
def test_same_as_blenders_light(scene: bpy.types.Scene, kind: str) -> None:
    _light(scene, kind)
    seen, expected = _render_both(scene)
    assert expected.max() > 0.05
    # Cycles samples a pixel's area at random; the cone's edge is steep.
    assert np.abs(seen - expected).mean() < 0.004 * expected.max()
    if kind == "SPOT":
        assert (expected == 0).any(), "the cone's edge must be in the picture"


def test_exposure_and_temperature(scene: bpy.types.Scene) -> None:
    light = _light(scene, "SUN")
    light.data.exposure = 1.5
    light.data.use_temperature = True
    light.data.temperature = 3000.0
    seen, expected = _render_both(scene)
    assert np.abs(seen - expected).mean() < 0.004 * expected.max()


def test_light_is_followed_live(scene: bpy.types.Scene) -> None:
    """Moving, recolouring and changing the kind need no operator and no script permission."""
    light = _light(scene, "SUN")
    lights = light_set(scene)
    add_mesh(scene, "plane", _from_set(scene))
    first = render_pixels(scene)
    light.parent.rotation_euler = (0.9, 0.0, 0.0)
    light.data.color = (0.1, 0.2, 1.0)
    light.data.energy = pi
    assert np.abs(render_pixels(scene) - first).max() > 0.05
    light.data.type = "POINT"
    light.data.energy = 70.0
    light.data.shadow_soft_size = 0.0
    assert not bring_up_to_date(lights)
    seen = render_pixels(scene)
    plane = next(item for item in scene.objects if item.type == "MESH")
    plane.data.materials[0] = _white()
    expected = render_pixels(scene)
    assert np.abs(seen - expected).mean() < 0.004 * expected.max()


def test_drivers_need_no_script_permission(scene: bpy.types.Scene) -> None:
    _light(scene, "AREA")
    lights = light_set(scene)
    bpy.context.view_layer.update()
    curves = lights.animation_data.drivers
    assert len(curves) == 4 * 16
    for curve in curves:
        assert curve.driver.is_simple_expression, curve.driver.expression
        assert curve.driver.is_valid, curve.data_path


def test_lights_that_come_and_go_are_followed(scene: bpy.types.Scene) -> None:
    lights = light_set(scene)
    assert count_of(lights) == 0 and light_set(scene) == lights
    sun, area = _light(scene, "SUN"), _light(scene, "AREA")
    assert bring_up_to_date(lights) and count_of(lights) == 5
    assert not bring_up_to_date(lights)
    seen, expected = _render_both(scene)
    assert np.abs(seen - expected).mean() < 0.02 * expected.max()  # an area is sampled at random
    area.data.type = "POINT"
    assert bring_up_to_date(lights) and count_of(lights) == 2
    sun.hide_render = True
    assert bring_up_to_date(lights) and count_of(lights) == 1
    bpy.data.objects.remove(area)
    assert bring_up_to_date(lights) and count_of(lights) == 0


def test_a_collection_has_its_own_lights(scene: bpy.types.Scene) -> None:
    _light(scene, "SUN")
    chosen = bpy.data.collections.new("Chosen")
    scene.collection.children.link(chosen)
    spot = _light(scene, "SPOT")
    chosen.objects.link(spot)
    assert count_of(light_set(scene)) == 2
    assert shining(chosen) == [spot] and count_of(light_set(chosen)) == 1
