"""Translucent objects, whose light crosses from one neighbour into the next.

Cycles lets subsurface light walk inside one object only. Instanced neighbours would be dark along
the seams, so meshes with such a material become one object that spans all neighbours.
"""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix

# The Principled BSDF's input, and the node that always scatters.
_WEIGHT, _NODE = "Subsurface Weight", "ShaderNodeSubsurfaceScattering"

# Points of two neighbours closer than this, in widths of the patch, are one.
_WELD = 1e-5


def is_translucent(shape: bpy.types.Object) -> bool:
    """Whether an evaluated object is a mesh with subsurface scattering in one of its materials."""
    return shape.type == "MESH" and any(
        material.node_tree is not None and _scatters(material.node_tree)
        for material in materials_of(shape)
    )


def materials_of(shape: bpy.types.Object) -> list[bpy.types.Material]:
    """The materials of an evaluated object, also those that only its modifiers set."""
    slots = [slot.material for slot in shape.material_slots]
    own = list(getattr(shape.data, "materials", ()))
    return [material for material in [*slots, *own] if material is not None]


def add_welded(
    scene: bpy.types.Scene,
    collection: bpy.types.Collection,
    size: tuple[float, float],
    rings: tuple[int, int],
) -> bpy.types.Collection:
    """Link one mesh for each translucent object of a collection, with all its neighbours, to the
    scene; a collection of the other objects, which are instanced as ever.

    `rings` is how many neighbours there are to each side along x and y. Textures that follow the
    object's own coordinates do not repeat on such a mesh; UV maps and attributes do.
    """
    graph = scene.view_layers[0].depsgraph
    rest = bpy.data.collections.new("Patch")
    rest.instance_offset = collection.instance_offset
    for item in collection.all_objects:
        evaluated = item.evaluated_get(graph)
        if not is_translucent(evaluated):
            rest.objects.link(item)
        elif not item.hide_render:
            mesh = bpy.data.meshes.new_from_object(
                evaluated, preserve_all_data_layers=True, depsgraph=graph
            )
            mesh.transform(Matrix.Translation(-collection.instance_offset) @ item.matrix_world)
            welded = bpy.data.objects.new(item.name, mesh)
            scene.collection.objects.link(welded)
            for axis in (0, 1):
                _repeat(welded, axis, size[axis], rings[axis])
    return rest


def _repeat(item: bpy.types.Object, axis: int, side: float, rings: int) -> None:
    """Array modifier along one axis, centred."""
    steps = item.modifiers.new("Neighbours", "ARRAY")
    steps.use_relative_offset, steps.use_constant_offset = False, True
    offset = np.zeros(3)
    offset[axis] = side
    steps.constant_offset_displace = offset
    steps.count = 2 * rings + 1
    steps.use_merge_vertices, steps.merge_threshold = True, _WELD * side
    item.location[axis] -= rings * side


def _scatters(tree: bpy.types.NodeTree) -> bool:
    for node in tree.nodes:
        if node.bl_idname == _NODE:
            return True
        if node.type == "GROUP" and node.node_tree is not None and _scatters(node.node_tree):
            return True
        weight = node.inputs.get(_WEIGHT)
        if weight is not None and (weight.is_linked or weight.default_value > 0.0):
            return True
    return False
