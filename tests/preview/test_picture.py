"""Pictures of the engine: the tangent frame, lights against Cycles, shadows, occlusion."""

from __future__ import annotations

from math import pi

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix, Vector

from addon.errors import NacreError
from addon.nodes.material import material_from_tables, set_coverage
from addon.preview.appearance import Appearance
from addon.preview.lights import light_rows, lights_of
from addon.preview.picture import camera_picture
from addon.preview.shadow_maps import draw_shadow_maps
from addon.render.engines import render_pixels, set_engine
from addon.render.stage import add_camera, add_mesh, add_sun, new_scene
from addon.tables.parabolic import texel_directions

pytestmark = pytest.mark.usefixtures("need_gpu")


def picture(scene, appearance, samples=1):
    layer = scene.view_layers[0]
    layer.update()
    size = scene.render.resolution_x, scene.render.resolution_y
    looks = appearance if callable(appearance) else lambda _material: appearance
    return camera_picture(layer.depsgraph, size, samples, looks)[0]


def plane(scene, uv=((1, 0), (0, 1)), name="plane"):
    """A unit plane whose UV map is a matrix times (x, y)."""
    item = add_mesh(scene, "plane", bpy.data.materials.new(name))
    layer = item.data.uv_layers[0].uv
    for corner in layer:
        corner.vector = np.array(uv) @ np.array(corner.vector)
    return item


FRAMES = {
    "upright": (((1, 0), (0, 1)), (0, 0, 0), (1, 1, 1)),
    "mirrored UVs": (((-1, 0), (0, 1)), (0, 0, 0), (1, 1, 1)),
    "turned UVs": (((0, 1), (-1, 0)), (0, 0, 0), (1, 1, 1)),
    "turned object": (((1, 0), (0, 1)), (0.2, -0.3, 2.0), (1, 1, 1)),
    "mirrored object": (((1, 0), (0, 1)), (0.1, 0.2, 0.7), (-1, 1, 1)),
    "both": (((0, -1), (-1, 0)), (0, 0.3, 0.5), (1, -2, 1)),
    "from behind": (((1, 0), (0, 1)), (pi - 0.2, 0.1, 0.4), (1, 1, 1)),
}


@pytest.mark.parametrize("name", FRAMES)
def test_frame(name, direction_tables):
    """x along +u and y along +v on the surface, whatever is mirrored; z towards the viewer."""
    uv, turn, scale = FRAMES[name]
    light = Vector((0.5, 0.3, 0.8)).normalized()
    with new_scene((4, 4)) as scene:
        item = plane(scene, uv)
        item.rotation_euler, item.scale = turn, scale
        add_camera(scene, (0.0, 0.0), 0.05)
        theta = np.degrees(np.arccos(light.z))
        sun = add_sun(scene, (theta, np.degrees(np.arctan2(light.y, light.x))))
        sun.data.use_shadow = False
        seen = picture(scene, Appearance(btf=direction_tables))[2, 2, :3]
    # Rows of the inverse are where u and v grow by one.
    along = np.linalg.inv(np.array(uv, float))
    matrix = np.array(Euler(turn).to_matrix()) @ np.diag(scale)
    tangent, bitangent = (matrix @ np.array([*along[:, axis], 0.0]) for axis in (0, 1))
    normal = np.cross(tangent, bitangent)
    normal *= np.sign(normal[2])
    axes = [axis / np.linalg.norm(axis) for axis in (tangent, bitangent, normal)]
    expected = 0.5 + 0.5 * np.array([axis @ np.array(light) for axis in axes])
    np.testing.assert_allclose(seen, expected, atol=0.01)


def diffuse() -> bpy.types.Material:
    material = bpy.data.materials.new("White")
    if material.node_tree is None:
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    shader, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Color"].default_value = (1, 1, 1, 1)
    links.new(shader.outputs[0], output.inputs[0])
    return material


LIGHTS = {
    "SUN": {"energy": 2.0, "color": (1.0, 0.5, 0.2), "angle": 0.0},
    "POINT": {"energy": 30.0, "exposure": 0.5, "shadow_soft_size": 0.0},
    "SPOT": {"energy": 50.0, "spot_size": 0.9, "spot_blend": 0.5, "shadow_soft_size": 0.0},
    "AREA": {"energy": 20.0, "size": 0.3},
}


@pytest.mark.parametrize("kind", LIGHTS)
def test_lights_are_those_of_cycles(kind):
    with new_scene((16, 16)) as scene:
        data = bpy.data.lights.new("Light", kind)
        for name, value in LIGHTS[kind].items():
            setattr(data, name, value)
        lamp = bpy.data.objects.new("Light", data)
        lamp.location = (0.5, -0.3, 1.2)
        lamp.rotation_mode = "QUATERNION"
        lamp.rotation_quaternion = Vector((0.4, -0.4, 1.0)).to_track_quat("Z", "Y")
        scene.collection.objects.link(lamp)
        add_mesh(scene, "plane", diffuse()).scale = (2, 2, 2)
        add_camera(scene, (0.0, 0.0), 1.6)
        scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
        seen = picture(scene, Appearance(base=(1, 1, 1)), 16)[..., :3]
        set_engine(scene, "cycles", 64)
        scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 1.0
        expected = render_pixels(scene)
    assert expected.mean() > 0.05
    assert np.abs(seen - expected).mean() / expected.mean() < 0.02


@pytest.mark.parametrize("kind", ["SUN", "POINT", "SPOT"])
def test_shadows_are_those_of_cycles(kind):
    """A sphere over a plane: nothing lit turns dark, and what is dark in Cycles is dark."""
    with new_scene((64, 64)) as scene:
        data = bpy.data.lights.new("Light", kind)
        data.energy = {"SUN": pi, "POINT": 300.0, "SPOT": 300.0}[kind]
        if kind == "SUN":
            data.angle = 0.0
        else:
            data.shadow_soft_size = 0.0
        if kind == "SPOT":
            data.spot_size = 1.2
        lamp = bpy.data.objects.new("Light", data)
        lamp.location = (1.5, 0.8, 2.5)
        lamp.rotation_mode = "QUATERNION"
        lamp.rotation_quaternion = lamp.location.to_track_quat("Z", "Y")
        scene.collection.objects.link(lamp)
        white = diffuse()
        add_mesh(scene, "plane", white).scale = (4, 4, 4)
        ball = add_mesh(scene, "sphere", white)
        ball.scale, ball.location = (0.4, 0.4, 0.4), (0.0, 0.0, 0.6)
        add_camera(scene, (30.0, 250.0), 3.0)
        scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
        seen = picture(scene, Appearance(base=(1, 1, 1)), 4)[..., :3]
        set_engine(scene, "cycles", 16)
        scene.cycles.max_bounces = 0
        expected = render_pixels(scene)
    dark = expected.mean(-1) < 1e-3
    assert 0.01 < dark.mean() < 0.5
    assert np.abs(seen - expected).mean() / expected.mean() < 0.03


def test_what_is_partly_visible_is_hidden_by_what_is_in_front(random_tables):
    """Though it is drawn last; and hides nothing itself that is drawn after it (Section 6.3.3)."""
    tables = half_hole(random_tables)
    looks = {
        "near": Appearance(base=(0, 0.5, 0)),
        "net": Appearance(occlusion=tables, visibility=(0.1, 10.0), base=(1, 1, 1)),
        "other": Appearance(occlusion=tables, visibility=(0.1, 10.0), base=(1, 0, 0)),
    }
    for names in (("near", "net"), ("net", "near")):
        with new_scene((32, 32)) as scene:
            for name in names:
                plane(scene, name=name).location.z = -0.5 * (name == "net")
            add_camera(scene, (0.0, 0.0), 1.0)
            add_sun(scene, (0.0, 0.0)).data.use_shadow = False
            scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
            seen = picture(scene, lambda material: looks[material.name.split(".")[0]])
        np.testing.assert_allclose(seen[16, :, :3], np.tile((0, 0.5, 0), (32, 1)), atol=0.01)
    # Two nets, one over the other: where both are half visible, both are seen.
    with new_scene((32, 32)) as scene:
        for name in ("other", "net"):
            plane(scene, name=name).location.z = -0.5 * (name == "net")
        add_camera(scene, (0.0, 0.0), 1.0)
        add_sun(scene, (0.0, 0.0)).data.use_shadow = False
        seen = picture(scene, lambda material: looks[material.name.split(".")[0]])[16, 20, :3]
    assert seen[0] > seen[1] > 0.2


def test_equal_lights_share_their_shadow_maps():
    """As those of a scene and of a collection in it; one without shadows has none."""
    data = bpy.data.lights.new("Point", "POINT")
    point = lights_of(data, Matrix.Translation((0.0, 0.0, 2.0)))
    again = lights_of(data, Matrix.Translation((0.0, 0.0, 2.0)))
    other = lights_of(data, Matrix.Translation((0.0, 1.0, 2.0)))
    data.use_shadow = False
    without = lights_of(data, Matrix.Translation((0.0, 0.0, 2.0)))
    views = []
    lights = [*point, *again, *without, *other]
    shadows = draw_shadow_maps(lights, np.array([[-1.0] * 3, [1.0] * 3]), views.append)
    assert len(views) == 12
    rows = light_rows(lights, shadows.places)
    assert rows[0, 0] == 4
    assert rows[1:].reshape(-1, 4, 4)[:4, 1, 3].tolist() == [0, 0, -1, 6]


def half_hole(random_tables):
    """Occlusion that is a hole for u < 1/2, barely covered from there to 3/4, and covered beyond,
    for every view."""
    tables = random_tables(occlusion=True, rank=1, view_quads=1, texels=(16, 16), size=32)
    core, view = np.zeros_like(tables.core), np.zeros_like(tables.view)
    view[..., 0] = 1.0
    core[..., :8, 0], core[..., 8:12, 0], core[..., 12:, 0] = -0.5, 0.05, 0.5
    return type(tables)(core, None, view, tables.light_index, tables.view_index)


def test_occlusion_blends_with_what_is_behind(random_tables):
    """Eq. 26 with threshold 0.1 and weight 10: invisible, half visible, fully visible."""
    tables = half_hole(random_tables)
    looks = {
        "net": Appearance(occlusion=tables, visibility=(0.1, 10.0), base=(1, 1, 1)),
        "behind": Appearance(base=(0, 0.5, 0)),
    }
    for first in ("net", "behind"):  # the order of drawing does not matter
        with new_scene((32, 32)) as scene:
            items = {
                name: plane(scene, name=name) for name in sorted(looks, reverse=first == "net")
            }
            items["behind"].location.z = -0.5
            add_camera(scene, (0.0, 0.0), 1.0)
            add_sun(scene, (0.0, 0.0)).data.use_shadow = False
            scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
            seen = picture(scene, lambda material: looks[material.name.split(".")[0]])[16, :, :3]
        np.testing.assert_allclose(seen[6], (0, 0.5, 0), atol=0.01)
        np.testing.assert_allclose(seen[20], (0.5, 0.75, 0.5), atol=0.02)
        np.testing.assert_allclose(seen[28], (1, 1, 1), atol=0.01)


@pytest.mark.parametrize("kind", ["SUN", "POINT"])
def test_light_through_holes_is_that_of_cycles(kind, random_tables, smooth_tables):
    """A net over a plane: black, so that only its shadow is lit."""
    tables = half_hole(random_tables)
    tables.core[..., 8:12, 0] = 0.2  # with a weight of 10 nothing is half covered
    looks = {
        "net": Appearance(occlusion=tables, visibility=(0.1, 10.0), base=(0, 0, 0)),
        "White": Appearance(base=(1, 1, 1)),
    }
    with new_scene((96, 96)) as scene:
        net = material_from_tables(smooth_tables(), "net")
        set_coverage(net, tables, (0.1, 10.0))
        item = add_mesh(scene, "plane", net)
        for corner in item.data.uv_layers[0].uv:
            corner.vector *= 2.0
        item.location.z = 0.6
        add_mesh(scene, "plane", diffuse()).scale = (4, 4, 4)
        if kind == "SUN":
            add_sun(scene, (40.0, 30.0))
        else:
            data = bpy.data.lights.new("Light", kind)
            data.energy, data.shadow_soft_size = 100.0, 0.0
            lamp = bpy.data.objects.new("Light", data)
            lamp.location = (0.5, -0.3, 1.6)
            scene.collection.objects.link(lamp)
        add_camera(scene, (35.0, 250.0), 2.6)
        scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
        seen = picture(scene, lambda material: looks[material.name.split(".")[0]], 4)[..., :3]
        item.location.z = -1.0
        without = picture(scene, lambda material: looks[material.name.split(".")[0]], 4)[..., :3]
        item.location.z = 0.6
        set_engine(scene, "cycles", 16)
        scene.cycles.max_bounces, scene.cycles.transparent_max_bounces = 0, 8
        expected = render_pixels(scene)
    assert np.abs(seen - without).mean() / expected.mean() > 0.1
    assert np.abs(seen - expected).mean() / expected.mean() < 0.02


def test_holes_are_those_that_the_light_sees(random_tables):
    """Covered towards +x and open towards -x: a sun on one side gets through."""
    tables = half_hole(random_tables)
    tables.core[...] = (1.0, 0.0, 0.0, 0.0)
    tables.view[..., 0] = texel_directions(tables.size)[..., 0]
    looks = {
        "net": Appearance(occlusion=tables, visibility=(0.1, 10.0)),
        "ground": Appearance(base=(1, 1, 1)),
    }
    lit = []
    for azimuth in (0.0, 180.0):
        with new_scene((8, 8)) as scene:
            net = plane(scene, name="net")
            net.location.z, net.scale = 0.5, (4, 4, 1)
            plane(scene, name="ground")
            add_camera(scene, (30.0, 180.0), 0.2)  # where the net is open
            add_sun(scene, (40.0, azimuth))
            seen = picture(scene, lambda material: looks[material.name.split(".")[0]])
            lit.append(seen[4, 4, 0])
    # What is left of the first is the world's plain light.
    assert lit[0] < 0.03
    assert lit[1] == pytest.approx(np.cos(np.radians(40.0)) + 0.02, abs=0.01)


def test_several_materials_on_one_mesh(direction_tables):
    looks = {"left": Appearance(base=(1, 0, 0)), "right": Appearance(btf=direction_tables)}
    with new_scene((8, 8)) as scene:
        item = plane(scene, name="left")
        mesh = bpy.data.meshes.new("halves")
        mesh.from_pydata(
            [(-1, -1, 0), (0, -1, 0), (0, 1, 0), (-1, 1, 0), (1, -1, 0), (1, 1, 0)],
            [],
            [(0, 1, 2, 3), (1, 4, 5, 2)],
        )
        mesh.uv_layers.new(name="UVMap")
        for corner, loop in zip(mesh.uv_layers[0].uv, mesh.loops, strict=True):
            corner.vector = mesh.vertices[loop.vertex_index].co.xy
        mesh.materials.append(item.data.materials[0])
        mesh.materials.append(bpy.data.materials.new("right"))
        mesh.polygons[1].material_index = 1
        item.data = mesh
        add_camera(scene, (0.0, 0.0), 1.8)
        add_sun(scene, (0.0, 0.0))
        seen = picture(scene, lambda material: looks[material.name.split(".")[0]])
    np.testing.assert_allclose(seen[4, 1, :3], (1.02, 0, 0), atol=0.03)
    np.testing.assert_allclose(seen[4, 6, :3], (0.5, 0.5, 1.0), atol=0.02)


def test_faces_of_many_corners_and_no_uv_map():
    with new_scene((8, 8)) as scene:
        bpy.ops.mesh.primitive_circle_add(vertices=9, fill_type="NGON", radius=2.0)
        circle = bpy.context.object
        scene.collection.objects.link(circle)
        add_camera(scene, (0.0, 0.0), 1.0)
        add_sun(scene, (0.0, 0.0))
        with_uv = picture(scene, Appearance(base=(1, 1, 1)))
        circle.data.uv_layers.remove(circle.data.uv_layers[0])
        without = picture(scene, Appearance(base=(1, 1, 1)))
    np.testing.assert_allclose(with_uv[4, 4, :3], 1.02, atol=0.02)
    np.testing.assert_allclose(without, with_uv, atol=1e-3)


def test_no_camera_is_said():
    with new_scene((4, 4)) as scene, pytest.raises(NacreError, match="no camera"):
        picture(scene, Appearance())
