"""The node that turns a world, and directions turned with it in a shader tree."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from numpy.typing import NDArray

from .graph import Graph, Wire


def turning_node(world: bpy.types.World) -> bpy.types.ShaderNodeMapping | None:
    """The Mapping node that turns all of a world: the one between the world's directions and its
    only Environment Texture, when nothing else of it is set."""
    nodes = list(world.node_tree.nodes) if world.node_tree else []
    directional = [n for n in nodes if n.type.startswith("TEX_") and n.type != "TEX_COORD"]
    if len(directional) != 1 or directional[0].type != "TEX_ENVIRONMENT":
        return None
    if any(node.type in ("GROUP", "NEW_GEOMETRY") for node in nodes):
        return None
    links = directional[0].inputs["Vector"].links
    node = links[0].from_node if links else None
    if node is None or node.type != "MAPPING" or node.vector_type != "POINT":
        return None
    source = node.inputs["Vector"].links
    if not source or source[0].from_socket.identifier != "Generated":
        return None
    if any(node.inputs[name].is_linked for name in ("Location", "Rotation", "Scale")):
        return None
    plain = tuple(node.inputs["Location"].default_value) == (0.0, 0.0, 0.0)
    plain &= tuple(node.inputs["Scale"].default_value) == (1.0, 1.0, 1.0)
    # Directions may be used elsewhere too, to mix with the horizon say.
    users = [link for link in world.node_tree.links if link.from_node == source[0].from_node]
    return node if plain and len(users) == 1 else None


def rotation_of(mapping: bpy.types.ShaderNodeMapping | None) -> NDArray[np.float64]:
    """The matrix (3, 3) that takes directions in the scene to those of the picture."""
    if mapping is None:
        return np.eye(3)
    return np.array(mapping.inputs["Rotation"].default_value.to_matrix())


def turned(
    g: Graph, axes: Sequence[Wire], world: bpy.types.World, mapping: bpy.types.ShaderNodeMapping
) -> list[Wire]:
    """Directions in the scene as those of the picture, driven by the world's own rotation.

    They follow its keys; after an edit they follow once `follow_world` was called.
    """
    path = f'node_tree.nodes["{bpy.utils.escape_identifier(mapping.name)}"].inputs["Rotation"]'
    found = []
    for axis in axes:
        node = g.node("ShaderNodeMapping", axis, vector_type="POINT")
        for index in range(3):
            driver = node.inputs["Rotation"].driver_add("default_value", index).driver
            driver.type = "SUM"
            variable = driver.variables.new()
            variable.targets[0].id_type = "WORLD"
            variable.targets[0].id = world
            variable.targets[0].data_path = f"{path}.default_value[{index}]"
        found.append(g.wire(node))
    return found


def follow_world(
    world: bpy.types.World, mapping: bpy.types.ShaderNodeMapping, driven: bpy.types.Node
) -> bool:
    """Let what `turned` wrote follow an edit of the world's rotation; whether there was one.

    `driven` is one of the nodes written. Blender evaluates their drivers when the world is tagged,
    and an edit of its nodes tags only these.
    """
    wanted, found = (node.inputs["Rotation"].default_value for node in (mapping, driven))
    if np.allclose(wanted, found, atol=1e-6):
        return False
    world.update_tag()
    return True
