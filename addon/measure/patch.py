"""The patch under the instrument: a square piece of the scene that repeats in x and y."""

from __future__ import annotations

import math
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Vector

from ..errors import NacreError


@dataclass(frozen=True)
class Patch:
    """A collection that lies on the square of side `size` metres around the world's origin.

    The reference plane is z = 0; +x is u, +y is v. What crosses the square's edge comes back on the
    opposite side, as the neighbours do the same.
    """

    collection: bpy.types.Collection
    size: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.size) and self.size > 0):
            raise ValueError(f"size: expected a positive length in metres, got {self.size}")


def place(scene: bpy.types.Scene, patch: Patch, slope: float) -> float:
    """Instance the patch and its neighbours into an empty scene; how high it rises in metres.

    `slope` is the largest sum of tan(theta) of a view and a light: so far, in heights of the
    patch, a ray and its shadow may wander. Raises NacreError for a patch with nothing in it.
    """
    _instance(scene, patch.collection, 0.0, 0.0)
    low, high = _bounds(scene)
    reach = (high[2] - low[2]) * slope
    overhang = max(0.0, -patch.size / 2 - min(low[:2]), max(high[:2]) - patch.size / 2)
    rings = max(1, math.ceil((reach + overhang) / patch.size))
    for row in range(-rings, rings + 1):
        for column in range(-rings, rings + 1):
            if row or column:
                _instance(scene, patch.collection, column * patch.size, row * patch.size)
    return max(float(high[2]), 0.0)


def _instance(scene: bpy.types.Scene, collection: bpy.types.Collection, x: float, y: float) -> None:
    item = bpy.data.objects.new("Patch", None)
    item.instance_type, item.instance_collection = "COLLECTION", collection
    # An instance is moved back by the collection's offset; the patch is where it is in the world.
    item.location = Vector((x, y, 0.0)) + collection.instance_offset
    scene.collection.objects.link(item)


def _bounds(scene: bpy.types.Scene) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner (3,) of what the scene shows, instances included."""
    layer = scene.view_layers[0]
    layer.update()
    graph = layer.depsgraph
    corners = [
        instance.matrix_world @ Vector(corner)
        for instance in graph.object_instances
        if instance.object.type in _SHAPES
        for corner in instance.object.bound_box
    ]
    if not corners:
        raise NacreError("the patch holds nothing that renders: put a mesh or hair curves in it")
    found = np.array(corners)
    return found.min(0), found.max(0)


_SHAPES = {"MESH", "CURVE", "CURVES", "SURFACE", "META", "FONT", "POINTCLOUD", "VOLUME"}
