"""A scene of its own with one object, one sun and one camera, removed when done."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from math import ceil, pi
from pathlib import Path

import bmesh
import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..datasets.directions import spherical_to_unit
from ..errors import NacreError
from ..nodes.light_set import forget

MESH_IMPORTERS = {".obj": "obj_import", ".ply": "ply_import", ".stl": "stl_import"}


@contextmanager
def new_scene(size: tuple[int, int]) -> Iterator[bpy.types.Scene]:
    """An empty scene of a picture size (width, height); what it held is removed at the end."""
    before = {
        kind: set(getattr(bpy.data, kind))
        for kind in ("objects", "meshes", "lights", "cameras", "worlds", "collections")
    }
    scene = bpy.data.scenes.new("Nacre")
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.world = bpy.data.worlds.new("Nacre")
    if scene.world.node_tree is None:
        scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.02, 0.02, 0.02, 1)
    # EEVEE prepares the world's reflections before each picture: half of the time of a small one.
    scene.world.probe_resolution = "128"
    try:
        yield scene
    finally:
        forget(scene)
        bpy.data.scenes.remove(scene)
        for kind, kept in before.items():
            collection = getattr(bpy.data, kind)
            for item in set(collection) - kept:
                collection.remove(item)


def add_sun(scene: bpy.types.Scene, direction: tuple[float, float]) -> bpy.types.Object:
    """A white sun at (theta, phi) in degrees from +z and +x; of strength pi, so that a white
    diffuser reads cos(theta)."""
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy, sun.angle = pi, 0.0
    item = bpy.data.objects.new("Sun", sun)
    item.rotation_mode = "QUATERNION"
    item.rotation_quaternion = Vector(unit(direction)).to_track_quat("Z", "Y")
    scene.collection.objects.link(item)
    return item


def add_camera(
    scene: bpy.types.Scene, direction: tuple[float, float], span: float
) -> bpy.types.Object:
    """An orthographic camera at (theta, phi) in degrees that looks at the origin; `span` is the
    width or height of the picture, whichever is larger, in metres."""
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", span
    item = bpy.data.objects.new("Camera", camera)
    towards = Vector(unit(direction))
    # Up is +z where that can be seen, and +y for a view straight from above.
    up = Vector((0, 0, 1)) if towards.z < 0.9999 else Vector((0, 1, 0))
    right = up.cross(towards).normalized()
    item.matrix_world = (
        Matrix.Translation(towards * 10.0)
        @ Matrix((right, towards.cross(right), towards)).transposed().to_4x4()
    )
    scene.collection.objects.link(item)
    scene.camera = item
    return item


def unit(direction: tuple[float, float]) -> np.ndarray:
    """(theta, phi) in degrees as a unit vector."""
    return spherical_to_unit([direction[0]], [direction[1]])[0]


def add_mesh(
    scene: bpy.types.Scene, kind: str, material: bpy.types.Material, repeat: float = 4.0
) -> bpy.types.Object:
    """A unit plane, a cloth, a sphere or a mesh file, centred, with a UV map.

    `repeat` is how often the patch repeats along the object's width; a plane shows it once.
    """
    if kind == "plane":
        mesh = grid_mesh(kind, 1, lambda u, v: (u - 0.5, v - 0.5, 0.0), 1.0)
    elif kind == "cloth":
        mesh = grid_mesh(kind, 160, cloth, repeat)
    elif kind == "sphere":
        mesh = grid_mesh(kind, 160, sphere, 2 * ceil(repeat), wrap=True)
    else:
        mesh = _read_mesh(Path(kind), repeat)
    mesh.materials.clear()
    mesh.materials.append(material)
    item = bpy.data.objects.new(kind, mesh)
    scene.collection.objects.link(item)
    return item


def grid_mesh(name: str, cells: int, surface, repeat: float, wrap: bool = False) -> bpy.types.Mesh:
    """A smooth mesh of cells x cells quads from surface(u, v) -> (x, y, z), UVs times `repeat`."""
    steps = np.linspace(0.0, 1.0, cells + 1)
    vertices = [surface(u, v) for v in steps for u in steps]
    row = cells + 1
    corners = [
        (i + j * row, i + 1 + j * row, i + 1 + (j + 1) * row, i + (j + 1) * row)
        for j in range(cells)
        for i in range(cells)
    ]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], corners)
    across = (repeat, repeat / 2) if wrap else (repeat, repeat)
    uvs = np.array(
        [
            (steps[i % row] * across[0], steps[i // row] * across[1])
            for corner in corners
            for i in corner
        ]
    )
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", uvs.astype(np.float32).ravel())
    if wrap:  # the first and last columns are one seam, and each pole one vertex
        shape = bmesh.new()
        shape.from_mesh(mesh)
        bmesh.ops.remove_doubles(shape, verts=shape.verts, dist=1e-6)
        shape.to_mesh(mesh)
        shape.free()
    mesh.shade_smooth()
    return mesh


def cloth(u: float, v: float) -> tuple[float, float, float]:
    """Cloth laid over a ball, with folds, 2 m wide; no steep walls that would stretch a UV map."""
    x, y = 2 * u - 1, 2 * v - 1
    folds = 0.05 * np.sin(4 * x + 3 * y + 2 * np.sin(2 * y - x)) * (x**2 + y**2)
    return x, y, 0.55 * np.exp(-2.0 * (x**2 + y**2)) - 0.15 + folds


def sphere(u: float, v: float) -> tuple[float, float, float]:
    """A unit sphere with its poles along y, out of the way of a camera above."""
    turn, rise = 2 * pi * u, pi * (v - 0.5)
    return -np.cos(rise) * np.sin(turn), np.sin(rise), -np.cos(rise) * np.cos(turn)


SURFACES = {"cloth": cloth, "sphere": sphere}
"""Surfaces (u, v) -> (x, y, z), u and v from 0 to 1, numbers or arrays."""


def _read_mesh(path: Path, repeat: float) -> bpy.types.Mesh:
    """A mesh file scaled to 2 m; a box projection where it has no UV map."""
    importer = MESH_IMPORTERS.get(path.suffix.lower())
    if importer is None or not path.is_file():
        kinds = ", ".join(["plane", "cloth", "sphere", *MESH_IMPORTERS])
        raise NacreError(f"mesh {str(path)!r}: expected one of {kinds} (a file)")
    before = set(bpy.data.objects)
    getattr(bpy.ops.wm, importer)(filepath=str(path))
    imported = [item for item in set(bpy.data.objects) - before if item.type == "MESH"]
    if not imported:
        raise NacreError(f"mesh {str(path)!r}: holds no mesh")
    mesh = imported[0].data
    mesh.transform(imported[0].matrix_world)
    for item in imported:
        bpy.data.objects.remove(item)
    points = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", points)
    points = points.reshape(-1, 3)
    low, high = points.min(0), points.max(0)
    points = (points - (low + high) / 2) * (2.0 / max(1e-9, (high - low).max()))
    mesh.vertices.foreach_set("co", points.ravel())
    if not mesh.uv_layers:
        mesh.uv_layers.new(name="UVMap")
        _box_project(mesh, points)
    layer = mesh.uv_layers.active.uv
    uvs = np.empty(len(layer) * 2, np.float32)
    layer.foreach_get("vector", uvs)
    layer.foreach_set("vector", uvs * repeat)
    mesh.shade_smooth()
    mesh.update()
    return mesh


def _box_project(mesh: bpy.types.Mesh, points: np.ndarray) -> None:
    """UVs in half object widths from the two axes each face looks along least."""
    layer = mesh.uv_layers.active.uv
    for face in mesh.polygons:
        a, b = [axis for axis in range(3) if axis != int(np.argmax(np.abs(face.normal)))]
        for corner in face.loop_indices:
            point = points[mesh.loops[corner].vertex_index]
            layer[corner].vector = (point[a] / 2, point[b] / 2)
