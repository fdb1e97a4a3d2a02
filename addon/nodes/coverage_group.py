"""The node group that shows how far view-dependent occlusion is visible (K-CTA, Eq. 26).

Nacre MODEL Coverage   UV, View, Threshold, Weight -> Alpha
"""

from __future__ import annotations

import bpy

from .evaluation import Evaluation
from .graph import Graph
from .loops import clear
from .packed_tables import is_holder, store, stored
from .packed_tensor import PackedTensor
from .texel_group import make_texel_group

_SOCKETS = (
    ("UV", "Vector", "Texture coordinates in patches; whole numbers repeat the material"),
    ("View", "Vector", "Unit direction to the viewer: x tangent, y bitangent, z normal"),
    ("Threshold", "Float", "From here on the surface covers all that is behind it"),
    ("Weight", "Float", "Alpha of what lies between a hole and the threshold, for each unit"),
)


def make_coverage_group(
    name: str, packed: PackedTensor, mapping: tuple[float, float]
) -> bpy.types.ShaderNodeTree:
    """A group whose Alpha is that of occlusion; `mapping` is Eq. 26's threshold and weight."""
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    for label, kind, tip in _SOCKETS:
        socket = tree.interface.new_socket(label, in_out="INPUT", socket_type=f"NodeSocket{kind}")
        socket.description = tip
    for label, value in zip(("Threshold", "Weight"), mapping, strict=True):
        tree.interface.items_tree[label].default_value = value
    output = tree.interface.new_socket("Alpha", in_out="OUTPUT", socket_type="NodeSocketFloat")
    output.description = "1 where the material covers what is behind it, 0 in its holes"

    store(tree, packed)
    _write(tree, None)
    return tree


def lay_coverage(tree: bpy.types.ShaderNodeTree, image: bpy.types.Image | None) -> None:
    """Lay the holes by a map of coordinates, or repeat the patch."""
    texels = {node.node_tree for node in tree.nodes if node.type == "GROUP"}
    clear(tree, keep=is_holder)
    for texel in texels:
        bpy.data.node_groups.remove(texel)
    _write(tree, image)


def _write(tree: bpy.types.ShaderNodeTree, coordinates: bpy.types.Image | None) -> None:
    packed = stored(tree)
    texel = make_texel_group(f"{tree.name} Texel", packed)
    g = Graph(tree)
    inputs = g.node("NodeGroupInput")
    uv, view, threshold, weight = (g.wire(inputs, label) for label, *_ in _SOCKETS)
    (value,) = Evaluation(g, packed, texel, uv, view, coordinates).reduced
    partly = g.math("MINIMUM", g.math("MAXIMUM", value * weight, 0.0), 1.0)
    whole = g.math("SUBTRACT", 1.0, g.math("LESS_THAN", value, threshold))
    g.node("NodeGroupOutput", g.math("MAXIMUM", partly, whole))


def remove_coverage_group(tree: bpy.types.ShaderNodeTree) -> None:
    """Remove a group with all that was made for it."""
    images = [node.image for node in tree.nodes if is_holder(node)]
    texels = {node.node_tree for node in tree.nodes if node.type == "GROUP"}
    clear(tree)
    for item in (tree, *texels):
        bpy.data.node_groups.remove(item)
    for image in images:
        bpy.data.images.remove(image)
