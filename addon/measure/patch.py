"""The patch under the instrument: a rectangular piece of the scene that repeats in x and y."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

import bpy
import numpy as np
from mathutils import Vector

from ..errors import NacreError
from .translucent import add_welded, is_translucent, materials_of

# Quads along a side of the plane that carries a material with true displacement.
DISPLACED_QUADS = 512


@dataclass(frozen=True)
class Patch:
    """A collection that lies on a rectangle of `size` (width, height) in metres.

    The rectangle is centred on the collection's instance offset, the world's origin if it was never
    set, and horizontal; +x is u, +y is v. What crosses an edge comes back on the opposite side, as
    the neighbours do the same. `name` is the user's for it.
    """

    collection: bpy.types.Collection
    size: tuple[float, float]
    name: str = ""

    def __post_init__(self) -> None:
        if not all(math.isfinite(side) and side > 0 for side in self.size):
            raise ValueError(f"size: expected positive lengths in metres, got {self.size}")


@contextmanager
def open_patch(
    item: bpy.types.Object | bpy.types.Collection | bpy.types.Material,
    size: tuple[float, float] | None = None,
) -> Iterator[Patch]:
    """A patch of an object, a collection, or a material laid on a plane.

    An object's patch is centred on its origin and by default as large as it is; of the others
    `size` (width, height) in metres must be given. What was made for the patch is removed at the
    end. Raises NacreError for a missing size and an object without extent.
    """
    if isinstance(item, bpy.types.Collection):
        if size is None:
            raise NacreError(f"the collection {item.name} repeats after some length: give the size")
        yield Patch(item, size, item.name)
        return
    own = bpy.data.collections.new("Patch")
    made: list[bpy.types.ID] = [own]
    try:
        if isinstance(item, bpy.types.Object):
            size = size or _extent(item)
            own.objects.link(item)
            own.instance_offset = item.matrix_world.translation
        else:
            if size is None:
                raise NacreError(f"the material {item.name} has no size of its own: give the size")
            plane = _plane(item, size)
            own.objects.link(plane)
            made += [plane, plane.data]
        yield Patch(own, size, item.name)
    finally:
        bpy.data.batch_remove(made)


def place(
    scene: bpy.types.Scene,
    patch: Patch,
    slope: float,
    heights: Callable[[], tuple[float, float]] | None = None,
) -> float:
    """Instance the patch and its neighbours into an empty scene; how high it rises in metres.

    `slope` is the largest sum of tan(theta) of a view and a light: so far, in heights of the
    patch, a ray and its shadow may wander. `heights` finds the lowest and highest point in metres
    where a material's displacement leaves the objects' bounds. Raises NacreError for a patch with
    nothing in it.
    """
    _instance(scene, patch.collection, 0.0, 0.0)
    shown = _look_at(scene)
    low, high = shown.low, shown.high
    if shown.displaced and heights is not None:
        low[2], high[2] = heights()
    reach = (high[2] - low[2]) * slope
    overhang = np.maximum(np.maximum(-low, high)[:2] - np.array(patch.size) / 2, 0.0)
    columns, rows = (max(1, math.ceil(r)) for r in (reach + overhang) / patch.size)
    collection = patch.collection
    if shown.translucent:
        collection = add_welded(scene, patch.collection, patch.size, (columns, rows))
        _remove_instances(scene)
        _instance(scene, collection, 0.0, 0.0)
    for row in range(-rows, rows + 1):
        for column in range(-columns, columns + 1):
            if row or column:
                _instance(scene, collection, column * patch.size[0], row * patch.size[1])
    return max(float(high[2]), 0.0)


def _instance(scene: bpy.types.Scene, collection: bpy.types.Collection, x: float, y: float) -> None:
    """The instance's own place is that of the collection's instance offset."""
    item = bpy.data.objects.new("Patch", None)
    item.instance_type, item.instance_collection = "COLLECTION", collection
    item.location = (x, y, 0.0)
    scene.collection.objects.link(item)


def _remove_instances(scene: bpy.types.Scene) -> None:
    for item in [item for item in scene.objects if item.instance_type == "COLLECTION"]:
        bpy.data.objects.remove(item)


def _extent(item: bpy.types.Object) -> tuple[float, float]:
    """Width and height in metres of an object's bounding box along the world's x and y."""
    corners = np.array([item.matrix_world @ Vector(corner) for corner in item.bound_box])
    width, height, _ = np.ptp(corners, axis=0)
    if not (width > 0 and height > 0):
        raise NacreError(f"the object {item.name} has no extent in x and y: give the size")
    return float(f"{width:.6g}"), float(f"{height:.6g}")  # as single precision has them


def _plane(material: bpy.types.Material, size: tuple[float, float]) -> bpy.types.Object:
    """A plane at the world's origin that carries a material, its UV map from 0 to 1."""
    quads = 1 if material.displacement_method == "BUMP" else DISPLACED_QUADS
    steps = np.linspace(0.0, 1.0, quads + 1, dtype=np.float32)
    u, v = (axis.ravel() for axis in np.meshgrid(steps, steps))
    low = (np.arange(quads)[:, None] * (quads + 1) + np.arange(quads)).ravel()
    corners = np.stack([low, low + 1, low + quads + 2, low + quads + 1], -1).ravel()
    mesh = bpy.data.meshes.new("Plane")
    mesh.vertices.add(len(u))
    points = np.stack([size[0] * (u - 0.5), size[1] * (v - 0.5), np.zeros_like(u)], -1)
    mesh.vertices.foreach_set("co", points.ravel())
    mesh.loops.add(len(corners))
    mesh.loops.foreach_set("vertex_index", corners.astype(np.int32))
    mesh.polygons.add(len(low))
    mesh.polygons.foreach_set("loop_start", np.arange(0, len(corners), 4, dtype=np.int32))
    mesh.update(calc_edges=True)
    uvs = np.stack([u[corners], v[corners]], -1).ravel()
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", uvs)
    mesh.shade_smooth()
    mesh.materials.append(material)
    return bpy.data.objects.new("Plane", mesh)


class _Shown(NamedTuple):
    """What a scene shows: its lowest and highest corner (3,), by the objects' bounds, and whether
    some material moves its surface or lets light below it."""

    low: np.ndarray
    high: np.ndarray
    displaced: bool
    translucent: bool


def _look_at(scene: bpy.types.Scene) -> _Shown:
    """Raises NacreError when there is nothing."""
    layer = scene.view_layers[0]
    layer.update()
    corners, displaced, translucent = [], False, False
    for instance in layer.depsgraph.object_instances:  # whose objects live no longer than a step
        shape = instance.object
        if shape.type not in SHAPES:
            continue
        corners += [instance.matrix_world @ Vector(corner) for corner in shape.bound_box]
        displaced |= any(m.displacement_method != "BUMP" for m in materials_of(shape))
        translucent |= is_translucent(shape)
    if not corners:
        raise NacreError("the patch holds nothing that renders: put a mesh or hair curves in it")
    found = np.array(corners)
    return _Shown(found.min(0), found.max(0), displaced, translucent)


SHAPES = {"MESH", "CURVE", "CURVES", "SURFACE", "META", "FONT", "POINTCLOUD", "VOLUME"}
