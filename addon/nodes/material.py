"""A material that shows a model under one light of the scene."""

from __future__ import annotations

import bpy

from ..tables.tables import Tables
from .frame_group import frame_group
from .graph import Graph
from .light_group import drive_light, light_group
from .model_group import make_model_group

MODEL_NODE = "Nacre Model"
LIGHT_NODE = "Nacre Light"


def material_from_tables(
    tables: Tables, name: str, light: bpy.types.Object | None = None
) -> bpy.types.Material:
    """A material that evaluates a model's tables, lit by `light` (sun, point or spot).

    Raises NacreError when the tables do not fit a texture.
    """
    group = make_model_group(f"Nacre {name}", tables)
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # 4.5 makes the tree on request
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    g = Graph(tree)

    uv = g.node("ShaderNodeUVMap")
    scale = g.node("ShaderNodeVectorMath", g.wire(uv), (1.0, 1.0, 1.0), operation="MULTIPLY")
    scale.name = scale.label = "Repeat"
    lit = g.node("ShaderNodeGroup", node_tree=light_group())
    lit.name = LIGHT_NODE
    frame = g.node("ShaderNodeGroup", g.wire(lit, "Direction"), node_tree=frame_group())
    value = g.node(
        "ShaderNodeGroup",
        g.wire(scale),
        g.wire(frame, "View"),
        g.wire(frame, "Light"),
        node_tree=group,
    )
    value.name = MODEL_NODE
    shade = g.wire(value, "Value") * g.wire(lit, "Radiance")
    emission = g.node("ShaderNodeEmission", shade)
    output = g.node("ShaderNodeOutputMaterial", g.wire(emission))
    for column, node in enumerate((uv, scale, lit, frame, value, shade.socket.node, emission)):
        node.location, node.hide = (200.0 * column, 0.0), False
    output.location, output.hide = (1400.0, 0.0), False
    lit.location = (200.0, -250.0)
    material.preview_render_type = "SPHERE"
    set_light(material, light)
    return material


def set_light(material: bpy.types.Material, light: bpy.types.Object | None) -> None:
    """Light a Nacre material by another object, or by the default sun from +z."""
    drive_light(material.node_tree.nodes[LIGHT_NODE], light)


def is_nacre_material(material: bpy.types.Material | None) -> bool:
    """Whether a material was made here."""
    return (
        material is not None
        and material.node_tree is not None
        and LIGHT_NODE in material.node_tree.nodes
    )
