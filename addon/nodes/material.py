"""A material that shows a model under the lights of a scene."""

from __future__ import annotations

import bpy
from mathutils import Vector

from ..tables.tables import Tables
from .frame_group import frame_group
from .graph import Graph
from .light_set import Owner, bring_up_to_date, light_set
from .model_group import (
    lights_of,
    make_model_group,
    remove_model_group,
    show_lights,
    show_tables,
)
from .packed_tables import is_packed, pack

MODEL_NODE = "Nacre Model"
FINAL_NODE = "Nacre Final Model"


def material_from_tables(
    tables: Tables, name: str, lights: Owner | None = None
) -> bpy.types.Material:
    """A material that evaluates a model's tables, lit by the lights of a scene or collection.

    Raises NacreError when the tables do not fit a texture.
    """
    packed = pack(f"Nacre {name}", tables)
    group = make_model_group(f"Nacre {name}", packed, lights and light_set(lights))
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # 4.5 makes the tree on request
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    g = Graph(tree)

    uv = g.node("ShaderNodeUVMap")
    scale = g.node("ShaderNodeVectorMath", g.wire(uv), (1.0, 1.0, 1.0), operation="MULTIPLY")
    scale.name = scale.label = "Repeat"
    frame = g.node("ShaderNodeGroup", node_tree=frame_group())
    model = g.node(
        "ShaderNodeGroup",
        g.wire(scale),
        *(g.wire(frame, number) for number in range(len(frame.outputs))),
        node_tree=group,
    )
    model.name = MODEL_NODE
    emission = g.node("ShaderNodeEmission", g.wire(model))
    output = g.node("ShaderNodeOutputMaterial", g.wire(emission))
    for column, node in enumerate((uv, scale, frame, model, emission, output)):
        node.location, node.hide = (200.0 * column, 0.0), False
    frame.location = (200.0, -250.0)
    material.preview_render_type = "SPHERE"
    return material


def set_tables(material: bpy.types.Material, tables: Tables) -> None:
    """Show other tables in place: what is linked to the material's nodes stays."""
    group = group_of(material)
    show_tables(group, pack(group.name, tables), lights_of(group))


def set_final_tables(material: bpy.types.Material, tables: Tables | None) -> None:
    """Tables that take the place of others while a final render runs; None for the same ones.

    They wait in a node without links.
    """
    nodes = material.node_tree.nodes
    node = nodes.get(FINAL_NODE)
    if tables is None:
        if node is not None:
            remove_model_group(node.node_tree)
            nodes.remove(node)
    elif node is not None:
        show_tables(node.node_tree, pack(node.node_tree.name, tables), lights_of(node.node_tree))
    else:
        name = f"{group_of(material).name} Final"
        node = nodes.new("ShaderNodeGroup")
        node.node_tree = make_model_group(name, pack(name, tables), lights_of(group_of(material)))
        node.name = node.label = FINAL_NODE
        node.location = nodes[MODEL_NODE].location - Vector((0.0, 300.0))


def swap_final(material: bpy.types.Material) -> None:
    """Let the waiting tables and the shown ones change places."""
    nodes = material.node_tree.nodes
    final, shown = nodes.get(FINAL_NODE), nodes[MODEL_NODE]
    if final is not None:
        final.node_tree, shown.node_tree = shown.node_tree, final.node_tree


def set_lights(material: bpy.types.Material, owner: Owner) -> None:
    """Light a Nacre material by the lights that a scene or collection has now."""
    lights = light_set(owner)
    bring_up_to_date(lights)
    for group in groups_of(material):
        show_lights(group, lights)


def groups_of(material: bpy.types.Material) -> list[bpy.types.ShaderNodeTree]:
    """The node groups of a material's models: the shown one and the final one."""
    nodes = (material.node_tree.nodes.get(name) for name in (MODEL_NODE, FINAL_NODE))
    return [node.node_tree for node in nodes if node is not None]


def nacre_materials() -> list[bpy.types.Material]:
    """All materials in the file that were made here and can be changed."""
    return [item for item in bpy.data.materials if item.is_editable and is_nacre_material(item)]


def group_of(material: bpy.types.Material) -> bpy.types.ShaderNodeTree:
    """The node group that shows a material's model."""
    return material.node_tree.nodes[MODEL_NODE].node_tree


def is_nacre_material(material: bpy.types.Material | None) -> bool:
    """Whether a material was made here."""
    if material is None or material.node_tree is None:
        return False
    node = material.node_tree.nodes.get(MODEL_NODE)
    return node is not None and is_packed(node.node_tree)
