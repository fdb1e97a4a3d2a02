"""Patches of a few quads, small enough to measure in a moment."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import bpy
import pytest

from addon.measure.patch import Patch

# measured_monkey lies beside the tests.
sys.path.insert(0, str(Path(__file__).resolve().parent))

# Corner nearest the origin's lower left, opposite corner, height, linear colour.
Quad = tuple[tuple[float, float], tuple[float, float], float, tuple[float, float, float]]


@pytest.fixture(autouse=True)
def empty_file() -> None:
    """Each test starts from an empty .blend."""
    bpy.ops.wm.read_factory_settings(use_empty=True)


@pytest.fixture
def make_patch() -> Callable[..., Patch]:
    """A patch of side 1 m of horizontal quads; a shader node type other than diffuse if wanted."""

    def make(*quads: Quad, shader: str = "ShaderNodeBsdfDiffuse", **inputs: float) -> Patch:
        collection = bpy.data.collections.new("Patch")
        for low, high, height, colour in quads:
            x, y = zip(low, high, strict=True)
            corners = [(x[i], y[j], height) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
            mesh = bpy.data.meshes.new("Quad")
            mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
            mesh.materials.append(_material(shader, colour, inputs))
            collection.objects.link(bpy.data.objects.new("Quad", mesh))
        return Patch(collection, (1.0, 1.0))

    return make


def _material(
    shader: str, colour: tuple[float, float, float], inputs: dict[str, float]
) -> bpy.types.Material:
    material = bpy.data.materials.new("Test")
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    node = tree.nodes.new(shader)
    node.inputs["Color"].default_value = (*colour, 1)
    for name, value in inputs.items():
        node.inputs[name].default_value = value
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(node.outputs[0], output.inputs[0])
    return material
