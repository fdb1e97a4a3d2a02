"""The light group against Blender's own lights on a white diffuser."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

import bpy
import numpy as np
import pytest
from mathutils import Euler

from addon.nodes.graph import Graph
from addon.nodes.light_group import drive_light, light_group
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


def _from_group() -> tuple[bpy.types.Material, bpy.types.ShaderNodeGroup]:
    """Emission of the group's radiance times the cosine, which is a white diffuser."""
    material = _material("Group")
    g = Graph(material.node_tree)
    node = g.node("ShaderNodeGroup", node_tree=light_group())
    normal = g.wire(g.node("ShaderNodeNewGeometry"), "Normal")
    cosine = g.math("MAXIMUM", g.dot(normal, g.wire(node, "Direction")), 0.0)
    emission = g.node("ShaderNodeEmission", g.wire(node, "Radiance") * cosine)
    g.node("ShaderNodeOutputMaterial", g.wire(emission))
    return material, node


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
        data.energy, data.shadow_soft_size = 70.0, 0.0
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


def _render_both(scene: bpy.types.Scene, light: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    plane = add_mesh(scene, "plane", _white())
    expected = render_pixels(scene)
    material, node = _from_group()
    drive_light(node, light)
    plane.data.materials[0] = material
    return render_pixels(scene), expected


@pytest.mark.parametrize("kind", ["SUN", "POINT", "SPOT"])
def test_same_as_blenders_light(scene: bpy.types.Scene, kind: str) -> None:
    seen, expected = _render_both(scene, _light(scene, kind))
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
    seen, expected = _render_both(scene, light)
    assert np.abs(seen - expected).mean() < 0.004 * expected.max()


def test_light_is_followed_live(scene: bpy.types.Scene) -> None:
    """Moving, recolouring and changing the kind need no operator and no script permission."""
    light = _light(scene, "SUN")
    material, node = _from_group()
    add_mesh(scene, "plane", material)
    drive_light(node, light)
    first = render_pixels(scene)
    light.parent.rotation_euler = (0.9, 0.0, 0.0)
    light.data.color = (0.1, 0.2, 1.0)
    light.data.energy = pi
    assert np.abs(render_pixels(scene) - first).max() > 0.05
    light.data.type = "POINT"
    light.data.energy = 70.0
    light.data.shadow_soft_size = 0.0
    seen = render_pixels(scene)
    plane = next(item for item in scene.objects if item.type == "MESH")
    plane.data.materials[0] = _white()
    expected = render_pixels(scene)
    assert np.abs(seen - expected).mean() < 0.004 * expected.max()


def test_drivers_need_no_script_permission(scene: bpy.types.Scene) -> None:
    material, node = _from_group()
    drive_light(node, _light(scene, "SPOT"))
    bpy.context.view_layer.update()
    curves = material.node_tree.animation_data.drivers
    assert len(curves) == 14
    for curve in curves:
        assert curve.driver.is_simple_expression, curve.driver.expression
        assert curve.driver.is_valid, curve.data_path


def test_none_is_the_default_sun(scene: bpy.types.Scene) -> None:
    material, node = _from_group()
    add_mesh(scene, "plane", material)
    drive_light(node, _light(scene, "SUN"))
    render_pixels(scene)
    drive_light(node, None)
    assert not material.node_tree.animation_data.drivers
    np.testing.assert_allclose(render_pixels(scene)[2:-2, 2:-2], 1.0, rtol=1e-3)
