"""Objects, collections and materials as patches, wherever they are in the scene."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from addon.datasets.directions import spherical_to_unit
from addon.errors import NacreError
from addon.measure.btf import measure_btf
from addon.measure.patch import open_patch
from addon.measure.settings import Settings
from addon.measure.top_view import measure_top_view

UP = np.array([[0.0, 0.0, 1.0]])


def _material(name: str, colour=(0.8, 0.8, 0.8)) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True
    nodes = material.node_tree.nodes
    shader = nodes.new("ShaderNodeBsdfDiffuse")
    shader.inputs["Color"].default_value = (*colour, 1)
    material.node_tree.links.new(shader.outputs[0], nodes["Material Output"].inputs["Surface"])
    return material


def _quad(x: float, y: float, width: float, height: float, colour=(1, 1, 1)) -> bpy.types.Object:
    mesh = bpy.data.meshes.new("Quad")
    corners = [(x, y, 0), (x + width, y, 0), (x + width, y + height, 0), (x, y + height, 0)]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    mesh.materials.append(_material("Quad", colour))
    item = bpy.data.objects.new("Quad", mesh)
    bpy.context.scene.collection.objects.link(item)
    return item


def test_an_object_is_measured_where_it_is(tmp_path):
    """Twice as wide as high, off the world's origin, with a hole at its lower right."""
    item = _quad(-1, -0.5, 2, 1)
    bpy.data.objects.remove(_quad(0, 0, 1, 1))
    item.location = (7, -3, 2)
    bpy.context.view_layer.update()
    with open_patch(item) as patch:
        assert patch.size == (2.0, 1.0)
        dataset = measure_btf(patch, tmp_path / "a.nacre", UP, UP, Settings(8, 1))
        assert dataset.shape == (1, 1, 4, 8, 3) and dataset.patch_size == (2.0, 1.0)
        np.testing.assert_allclose(dataset.samples, 1, atol=1e-3)
    with open_patch(item, (4, 2)) as patch:
        dataset = measure_btf(patch, tmp_path / "a.nacre", UP, UP, Settings(8, 1))
    expected = np.zeros((4, 8))
    expected[1:3, 2:6] = 1
    np.testing.assert_allclose(dataset.samples[0, 0, ..., 0], expected, atol=1e-3)
    assert item.name in bpy.context.scene.collection.objects
    assert not bpy.data.collections


def test_a_collection_is_centred_on_its_instance_offset(tmp_path):
    collection = bpy.data.collections.new("Weave")
    item = _quad(5, 5, 0.5, 0.5)
    collection.objects.link(item)
    collection.instance_offset = (5.5, 5.5, 0)
    with open_patch(collection, (1, 1)) as patch:
        dataset = measure_btf(patch, tmp_path / "a.nacre", UP, UP, Settings(4, 1))
    expected = np.zeros((4, 4))
    expected[:2, :2] = 1
    np.testing.assert_allclose(dataset.samples[0, 0, ..., 0], expected, atol=1e-3)
    problem = "Weave repeats after some length: give the size"
    with pytest.raises(NacreError, match=problem), open_patch(collection):
        pass


def _displaced(height: float) -> bpy.types.Material:
    """A step: the right half of the UV map lies `height` metres higher."""
    material = _material("Step", (1, 1, 1))
    material.displacement_method = "DISPLACEMENT"
    nodes, links = material.node_tree.nodes, material.node_tree.links
    uv, split, step, displace = (
        nodes.new(f"ShaderNode{kind}")
        for kind in ("TexCoord", "SeparateXYZ", "Math", "Displacement")
    )
    step.operation = "GREATER_THAN"
    step.inputs[1].default_value = 0.5
    displace.inputs["Midlevel"].default_value, displace.inputs["Scale"].default_value = 0, height
    links.new(uv.outputs["UV"], split.inputs[0])
    links.new(split.outputs[0], step.inputs[0])
    links.new(step.outputs[0], displace.inputs["Height"])
    links.new(displace.outputs[0], nodes["Material Output"].inputs["Displacement"])
    return material


def test_a_material_is_measured_on_a_plane_with_its_displacement(tmp_path):
    with open_patch(_displaced(0.3), (1, 1)) as patch:
        top = measure_top_view(patch, (8, 8))
        view = spherical_to_unit([0, 45], [0, 180])
        light = spherical_to_unit([0, 45], [0, 0])
        dataset = measure_btf(patch, tmp_path / "a.nacre", light, view, Settings(8, 4, bounces=0))
    np.testing.assert_allclose(top["height"][:, :4], 0, atol=1e-3)
    np.testing.assert_allclose(top["height"][:, 5:], 0.3, atol=1e-3)
    # The step casts a shadow 0.3 m long to the left of both its copies, the neighbour's included.
    lit = dataset.samples[1, 0, 4, :, 0].astype(float) / light[1, 2]
    np.testing.assert_allclose(lit[[0, 5, 6]], 1, atol=0.02)
    np.testing.assert_allclose(lit[2:4], 0, atol=0.02)
    assert not bpy.data.collections and not bpy.data.meshes and not bpy.data.objects


def test_top_view(tmp_path):
    item = _quad(-0.5, -0.5, 0.75, 1, (0.8, 0.4, 0.2))
    item.location.z = 1.0
    item.rotation_euler.y = np.arctan(0.5)  # falls to the right
    bpy.context.view_layer.update()
    with open_patch(item, (1, 1)) as patch:
        top = measure_top_view(patch, (4, 4))
    assert {name: values.shape for name, values in top.items()} == {
        "albedo": (4, 4, 3), "normal": (4, 4, 3), "height": (4, 4, 1)
    }  # fmt: skip
    np.testing.assert_allclose(top["albedo"][:, 1], [(0.8, 0.4, 0.2)] * 4, rtol=0.02)
    normal = 2 * top["normal"][:, 1] - 1
    np.testing.assert_allclose(normal, [(0.2**0.5, 0, 0.8**0.5)] * 4, atol=1e-3)
    np.testing.assert_allclose(top["height"][:, :2, 0], [(0.1875, 0.0625)] * 4, atol=0.02)
    np.testing.assert_array_equal(top["albedo"][:, 3], 0)
    np.testing.assert_array_equal(top["normal"][:, 3], [(0.5, 0.5, 1)] * 4)


def _set_by_a_modifier(item: bpy.types.Object, material: bpy.types.Material) -> None:
    """Geometry nodes that give an object without materials one."""
    tree = bpy.data.node_groups.new("Set", "GeometryNodeTree")
    for side in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=side, socket_type="NodeSocketGeometry")
    first, last, node = (
        tree.nodes.new(kind)
        for kind in ("NodeGroupInput", "NodeGroupOutput", "GeometryNodeSetMaterial")
    )
    node.inputs["Material"].default_value = material
    tree.links.new(first.outputs[0], node.inputs["Geometry"])
    tree.links.new(node.outputs[0], last.inputs[0])
    item.data.materials.clear()
    item.modifiers.new("Set", "NODES").node_group = tree


@pytest.mark.parametrize("modifier", [False, True])
def test_translucent_light_crosses_from_one_neighbour_into_the_next(tmp_path, modifier):
    """A translucent slab without structure looks alike everywhere, at the edges, too."""
    item = _quad(-0.5, -0.5, 1, 1)
    material = bpy.data.materials.new("Wax")
    if material.node_tree is None:
        material.use_nodes = True
    inputs = material.node_tree.nodes["Principled BSDF"].inputs
    inputs["Subsurface Weight"].default_value = 1
    inputs["Subsurface Radius"].default_value = (1, 1, 1)
    inputs["Subsurface Scale"].default_value = 0.2
    if modifier:
        _set_by_a_modifier(item, material)
    else:
        item.data.materials[0] = material
    with open_patch(item) as patch:
        dataset = measure_btf(patch, tmp_path / "a.nacre", UP, UP, Settings(8, 256))
    found = dataset.samples[0, 0].astype(float).mean(-1)
    edge = np.concatenate([found[0], found[-1], found[:, 0], found[:, -1]]).mean()
    assert abs(edge / found[2:6, 2:6].mean() - 1) < 0.05
    assert [item.name for item in bpy.data.objects] == [item.name]


def test_mistakes():
    empty = bpy.data.objects.new("Empty", bpy.data.meshes.new("Empty"))
    with pytest.raises(NacreError, match="Empty has no extent in x and y"), open_patch(empty):
        pass
    with pytest.raises(NacreError, match="has no size of its own"), open_patch(_material("Red")):
        pass
