"""How much of each light arrives, against EEVEE's own shadows on a white diffuser."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import pi

import bpy
import numpy as np
import pytest
from mathutils import Vector

from addon.nodes.graph import Graph, Wire
from addon.nodes.light_set import bring_up_to_date, count_of, light_set, light_sets
from addon.nodes.material import group_of, material_from_tables, set_lights
from addon.nodes.model_group import lights_of
from addon.render.engines import render_pixels, set_engine
from addon.render.stage import add_camera, add_mesh, new_scene, unit
from addon.tables.tables import Tables

VIEW = (35.0, 90.0)


def _material(name: str) -> tuple[bpy.types.Material, Graph]:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material, Graph(material.node_tree)


def _white() -> bpy.types.Material:
    material, g = _material("White")
    diffuse = g.node("ShaderNodeBsdfDiffuse", (1.0, 1.0, 1.0, 1.0))
    g.node("ShaderNodeOutputMaterial", g.wire(diffuse))
    return material


def _from_set(scene: bpy.types.Scene, shadows: bool = True) -> bpy.types.Material:
    """Emission of the lights' radiances times their cosines, which is a white diffuser."""
    material, g = _material("Set")
    outputs = list(g.node("ShaderNodeGroup", node_tree=light_set(scene, shadows)).outputs)
    normal = g.wire(g.node("ShaderNodeNewGeometry"), "Normal")
    total = g.combine(0.0, 0.0, 0.0)
    for direction, radiance in zip(outputs[::2], outputs[1::2], strict=True):
        cosine = g.math("MAXIMUM", g.dot(normal, Wire(g, direction)), 0.0)
        total = total + Wire(g, radiance) * cosine
    g.node("ShaderNodeOutputMaterial", g.wire(g.node("ShaderNodeEmission", total)))
    return material


@pytest.fixture
def scene() -> Iterator[bpy.types.Scene]:
    """A plane that fills the picture."""
    with new_scene((32, 32)) as made:
        made.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
        add_camera(made, VIEW, 0.7)
        set_engine(made, "eevee", 1)
        made.eevee.use_shadows = True  # which Blender 4.5 leaves out of new scenes
        add_mesh(made, "plane", _white()).name = "Ground"
        yield made


def _light(
    scene: bpy.types.Scene, kind: str, at: tuple[float, float], colour: Sequence[float] = (1, 1, 1)
) -> bpy.types.Object:
    """A light that gives the middle about as much as a sun of strength pi, and in its way a lid
    out of the camera's."""
    data = bpy.data.lights.new(kind, kind)
    data.color = colour
    distance = 3.0
    data.energy = pi if kind == "SUN" else 4 * pi**2 * distance**2
    if kind == "SUN":
        data.angle = 0.01
    elif kind == "AREA":
        data.energy /= 4.0
        data.shape, data.size, data.size_y = "RECTANGLE", 0.3, 0.2
    else:
        data.shadow_soft_size = 0.05
    if kind == "SPOT":
        data.spot_size, data.spot_blend = 0.25, 0.3
    item = bpy.data.objects.new(kind, data)
    towards = Vector(unit(at))
    item.location = towards * distance
    item.rotation_mode = "QUATERNION"
    item.rotation_quaternion = towards.to_track_quat("Z", "Y")
    scene.collection.objects.link(item)
    lid = add_mesh(scene, "plane", _white())
    lid.location, lid.scale = 1.3 * towards, (0.3, 0.3, 1.0)
    return item


def _render_both(scene: bpy.types.Scene) -> tuple[np.ndarray, np.ndarray]:
    expected = render_pixels(scene)
    scene.objects["Ground"].data.materials[0] = _from_set(scene)
    return render_pixels(scene), expected


def test_shadow_of_another_object(scene: bpy.types.Scene) -> None:
    _light(scene, "AREA", (30.0, 230.0), (0.9, 0.5, 0.2))
    seen, expected = _render_both(scene)
    assert (expected < 0.1).mean() > 0.05 and (expected[..., 0] > 0.6).mean() > 0.3
    assert np.abs(seen - expected).mean() < 0.01 * expected.mean()


def test_shadows_of_several_lights_are_told_apart(scene: bpy.types.Scene) -> None:
    """Coloured lights, one without shadows, and a bright world that none of it sees."""
    _light(scene, "SUN", (40.0, 0.0), (1.0, 0.2, 0.1))
    _light(scene, "SPOT", (40.0, 180.0), (0.1, 1.0, 0.2))
    _light(scene, "POINT", (60.0, 270.0), (0.1, 0.3, 1.0)).data.use_shadow = False
    seen, expected = _render_both(scene)
    assert np.abs(seen - expected).mean() < 0.01 * expected.mean()
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
    again = render_pixels(scene)
    assert np.abs(again - seen).mean() < 0.015 * expected.mean()


def test_cycles_shows_all_of_each_light(scene: bpy.types.Scene) -> None:
    _light(scene, "SUN", (30.0, 230.0))
    set_engine(scene, "cycles", 1)
    ground = scene.objects["Ground"]
    pictures = []
    for shadows in (True, False):
        ground.data.materials[0] = _from_set(scene, shadows)
        pictures.append(render_pixels(scene))
    assert pictures[1].mean() > 0.5
    np.testing.assert_allclose(*pictures, rtol=1e-3)


def test_shadows_are_a_choice_of_each_material(scene: bpy.types.Scene, tables: Tables) -> None:
    """Both groups of lights follow what comes and goes."""
    _light(scene, "SUN", (30.0, 230.0))
    material = material_from_tables(tables, "Test", scene)
    scene.objects["Ground"].data.materials[0] = material
    lit = render_pixels(scene)
    set_lights(material, scene, shadows=True)
    assert lights_of(group_of(material)) == light_set(scene, shadows=True) != light_set(scene)
    dimmed = render_pixels(scene)
    hidden = (dimmed < 0.05 * lit).all(-1)
    assert 0.05 < hidden.mean() < 0.5
    assert np.abs(dimmed - lit)[~hidden].mean() < 0.05 * lit.mean()
    _light(scene, "AREA", (10.0, 0.0))
    assert [bring_up_to_date(lights) for lights in light_sets()] == [True, True]
    assert [count_of(lights) for lights in light_sets()] == [5, 5]
    bpy.context.view_layer.update()
    for lights in light_sets():
        for curve in lights.animation_data.drivers:
            assert curve.driver.is_simple_expression, curve.driver.expression
            assert curve.driver.is_valid, curve.data_path
