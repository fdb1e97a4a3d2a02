"""The measured scenes' own geometry bent on to an object along its UV map (shell mapping).

A point of the patch at (x, y, z) metres from its centre goes to S(u, v) + z N(u, v), where S is the
object's surface (addon.render.stage), N its normal and (u, v) where the patch and its copies lie on
the UV map: what a BTF on the smooth object stands for. The object is made so large that one
patch has its own size in metres, on average, because light goes a length in metres below wax.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import pi

import bpy
import numpy as np
from numpy.typing import NDArray

from addon.render.stage import SURFACES

Points = NDArray[np.float64]

QUADS = 125
"""Quads along a patch that carries a material with true displacement: more than its texels."""

BEHIND = -0.3
"""Patches whose normals' cosines to the camera are all below this are left out."""

WELD = 1e-6
"""Vertices no farther apart than this, in patches, are one."""


@dataclass(frozen=True)
class Object:
    """A surface with `repeat` (u, v) patches of `size` metres on it.

    One unit of the surface is `unit` metres, so that the patches have their own size.
    """

    surface: Callable[[NDArray, NDArray], tuple]
    repeat: tuple[int, int]
    size: tuple[float, float]
    unit: float

    @classmethod
    def of(cls, kind: str, across: int, size: tuple[float, float]) -> Object:
        """A sphere or cloth, the UV maps of addon.render.stage.add_mesh(repeat=across)."""
        repeat, length = {
            "cloth": ((across, across), 2.0),
            "sphere": ((2 * across, across), 2 * pi),
        }[kind]
        return cls(SURFACES[kind], repeat, size, repeat[0] * size[0] / length)

    def point(self, u: NDArray, v: NDArray) -> Points:
        """Where a UV coordinate of the whole object, (n,) from 0 to 1, lies, in metres: (n, 3)."""
        return self.unit * np.stack(np.broadcast_arrays(*self.surface(u, v)), -1)

    def frame(self, u: NDArray, v: NDArray) -> Points:
        """Tangent, bitangent and normal (n, 3, 3): orthonormal, the tangent along u."""
        step = 1e-4
        along = self.point(u + step, v) - self.point(u - step, v)
        up = self.point(u, v + step) - self.point(u, v - step)
        tangent = along / np.linalg.norm(along, axis=-1, keepdims=True)
        normal = np.cross(along, up)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        return np.stack([tangent, np.cross(normal, tangent), normal], 1)

    def bend(self, points: Points, column: int, row: int) -> Points:
        """Points (n, 3) in metres from a patch's centre as its copy in `column`, `row` has them."""
        u, v = (
            (number + 0.5 + points[:, axis] / self.size[axis]) / self.repeat[axis]
            for axis, number in enumerate((column, row))
        )
        return self.point(u, v) + points[:, 2:] * self.frame(u, v)[:, 2]

    def patches(self, towards: NDArray) -> Iterator[tuple[int, int]]:
        """Columns and rows of the patches that a camera in direction `towards` may see."""
        steps = np.array([0.01, 0.5, 0.99])
        for row in range(self.repeat[1]):
            for column in range(self.repeat[0]):
                u, v = np.meshgrid(
                    (column + steps) / self.repeat[0], (row + steps) / self.repeat[1]
                )
                if (self.frame(u.ravel(), v.ravel())[:, 2] @ towards).max() > BEHIND:
                    yield column, row


def add_real_geometry(
    scene: bpy.types.Scene, item: bpy.types.ID, shape: Object, towards: NDArray
) -> None:
    """The patch `item` (object, collection or material), bent on to an object, into a scene.

    Below it lies a black surface: under the measured patch was nothing, and so light that falls
    through is lost there, too, rather than coming back from the object's other side.
    """
    copies = list(shape.patches(towards))
    if isinstance(item, bpy.types.Material):
        lattice = _lattice(shape.size)
        _add_mesh(scene, shape, copies, *lattice, [item], with_uv=True)
        lowest = 0.0
    else:
        parts = [item] if isinstance(item, bpy.types.Object) else list(item.all_objects)
        lowest = min(_add_bent(scene, shape, copies, part) for part in parts)
    # A material's displacement is Cycles' own: as deep as the sample moves its surface at most.
    depth = max(-lowest, 0.0) + 0.1 * shape.size[0]
    _add_backing(scene, shape, -depth)


def _add_bent(scene, shape: Object, copies, part: bpy.types.Object) -> float:
    """Copies of one object in the scene; its lowest point in metres."""
    to_patch = np.array(part.matrix_world)
    if part.type == "CURVES":
        points = _numbers(part.data.attributes["position"].data, "vector", 3)
        points = points @ to_patch[:3, :3].T + to_patch[:3, 3]
        _add_curves(scene, shape, copies, part.data, points)
    else:
        mesh = part.data
        points = _numbers(mesh.vertices, "co", 3) @ to_patch[:3, :3].T
        corners = _numbers(mesh.loops, "vertex_index", 1, np.int32).ravel()
        _add_mesh(scene, shape, copies, points, corners.reshape(-1, 4), list(mesh.materials))
    return float(points[:, 2].min())


def _add_curves(scene, shape: Object, copies, data: bpy.types.Curves, points: Points) -> None:
    bent = np.concatenate([shape.bend(points, *copy) for copy in copies])
    radius = _numbers(data.attributes["radius"].data, "value", 1).ravel()
    sizes = [curve.points_length for curve in data.curves]
    curves = bpy.data.hair_curves.new(data.name)
    curves.add_curves(sizes * len(copies))
    curves.attributes["position"].data.foreach_set("vector", bent.astype(np.float32).ravel())
    layer = curves.attributes.get("radius") or curves.attributes.new("radius", "FLOAT", "POINT")
    layer.data.foreach_set("value", np.tile(radius, len(copies)).astype(np.float32))
    for material in data.materials:
        curves.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new(data.name, curves))


def _add_mesh(
    scene, shape: Object, copies, points: Points, corners: NDArray, materials, with_uv: bool = False
) -> None:
    """Quads (n, 4) of a patch, its copies welded where they meet, so that shading goes across."""
    flat = [points / (*shape.size, 1.0) + (column, row, 0.0) for column, row in copies]
    keys = np.concatenate(flat)
    if shape.surface is SURFACES["sphere"]:  # goes round
        keys[:, 0] = np.mod(keys[:, 0] + 0.5 + WELD, shape.repeat[0]) - 0.5 - WELD
    keys[:, 2] /= shape.size[0]
    _, first, place = np.unique(
        np.round(keys / WELD), axis=0, return_index=True, return_inverse=True
    )
    bent = np.concatenate([shape.bend(points, *copy) for copy in copies])[first]
    quads = np.concatenate([corners + number * len(points) for number in range(len(copies))])
    mesh = mesh_of(bent, place.ravel()[quads])
    if with_uv:
        uvs = np.concatenate(flat)[quads.ravel(), :2] + 0.5
        mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", uvs.astype(np.float32).ravel())
    for material in materials:
        mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("Patches", mesh))


def _add_backing(scene, shape: Object, height: float) -> None:
    steps = np.linspace(0.0, 1.0, 97)
    u, v = (axis.ravel() for axis in np.meshgrid(steps, steps))
    points = shape.point(u, v) + height * shape.frame(u, v)[:, 2]
    black = bpy.data.materials.new("Black")
    if black.node_tree is None:  # before 5.0
        black.use_nodes = True
    tree = black.node_tree
    tree.nodes.clear()
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Strength"].default_value = 0.0
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(emission.outputs[0], output.inputs[0])
    mesh = mesh_of(points, grid_quads(len(steps) - 1))
    mesh.materials.append(black)
    scene.collection.objects.link(bpy.data.objects.new("Backing", mesh))


def mesh_of(points: Points, quads: NDArray) -> bpy.types.Mesh:
    """A smooth mesh of vertices (n, 3) and quads (m, 4)."""
    mesh = bpy.data.meshes.new("Bent")
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", points.astype(np.float32).ravel())
    mesh.loops.add(quads.size)
    mesh.loops.foreach_set("vertex_index", quads.astype(np.int32).ravel())
    mesh.polygons.add(len(quads))
    mesh.polygons.foreach_set("loop_start", np.arange(0, quads.size, 4, dtype=np.int32))
    mesh.update(calc_edges=True)
    mesh.shade_smooth()
    return mesh


def grid_quads(cells: int) -> NDArray:
    """Quads (cells^2, 4) of a grid of (cells + 1)^2 vertices."""
    low = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    return np.stack([low, low + 1, low + cells + 2, low + cells + 1], -1)


def _lattice(size: tuple[float, float]) -> tuple[Points, NDArray]:
    """A flat patch as vertices in metres and quads."""
    steps = np.linspace(-0.5, 0.5, QUADS + 1)
    x, y = (axis.ravel() for axis in np.meshgrid(steps, steps))
    return np.stack([size[0] * x, size[1] * y, np.zeros_like(x)], -1), grid_quads(QUADS)


def _numbers(collection, name: str, width: int, kind: type = np.float32) -> NDArray:
    values = np.empty(len(collection) * width, kind)
    collection.foreach_get(name, values)
    return values.reshape(-1, width)
