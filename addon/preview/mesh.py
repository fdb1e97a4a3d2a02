"""Meshes on the graphics card: position, normal, tangent with its sign, and UV of each corner."""

from __future__ import annotations

from dataclasses import dataclass

import bmesh
import bpy
import gpu
import numpy as np

LARGEST_TANGENT_FACE = 4  # Blender's tangents need triangles and quads


@dataclass(frozen=True)
class MeshBatches:
    """An object's triangles, a batch for each material slot used, and its corners' bounding box
    (2, 3) in the object's own space."""

    batches: tuple[tuple[int, gpu.types.GPUBatch], ...]
    bounds: np.ndarray


def mesh_batches(item: bpy.types.Object) -> MeshBatches | None:
    """Batches of an evaluated object; None when it has no faces.

    Tangents are those of the UV map that renders (MikkTSpace), as the nodes' Tangent has them.
    """
    try:
        mesh = item.to_mesh()
    except RuntimeError:  # a kind of object without geometry
        return None
    try:
        if mesh is None or not len(mesh.polygons):
            return None
        return _batches(mesh)
    finally:
        item.to_mesh_clear()


def corner_arrays(mesh: bpy.types.Mesh) -> dict[str, np.ndarray]:
    """position (n, 3), normal (n, 3), tangent (n, 4) and uv (n, 2) of a mesh's corners; tangents
    and UVs are zero where there is no UV map. Faces of more than four corners are cut first."""
    layer = next((uvs for uvs in mesh.uv_layers if uvs.active_render), mesh.uv_layers.active)
    name = layer.name if layer is not None else None
    if name is not None:
        totals = np.empty(len(mesh.polygons), np.int32)
        mesh.polygons.foreach_get("loop_total", totals)
        if totals.max() > LARGEST_TANGENT_FACE:
            _cut_large_faces(mesh)
        mesh.calc_tangents(uvmap=name)
    count = len(mesh.loops)
    points = _read(mesh.vertices, "co", 3)
    corners = np.empty(count, np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    tangent, uv = np.zeros((count, 4), np.float32), np.zeros((count, 2), np.float32)
    if name is not None:
        tangent[:, :3] = _read(mesh.loops, "tangent", 3)
        tangent[:, 3:] = _read(mesh.loops, "bitangent_sign", 1)
        uv = _read(mesh.uv_layers[name].uv, "vector", 2)
    return {
        "position": points[corners],
        "normal": _read(mesh.corner_normals, "vector", 3),
        "tangent": tangent,
        "uv": uv,
    }


def _batches(mesh: bpy.types.Mesh) -> MeshBatches:
    arrays = corner_arrays(mesh)
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    triangles, slots = np.empty(3 * count, np.int32), np.empty(count, np.int32)
    mesh.loop_triangles.foreach_get("loops", triangles)
    mesh.loop_triangles.foreach_get("material_index", slots)
    triangles = triangles.reshape(-1, 3)
    layout = gpu.types.GPUVertFormat()
    for name, array in arrays.items():
        layout.attr_add(id=name, comp_type="F32", len=array.shape[1], fetch_mode="FLOAT")
    vertices = gpu.types.GPUVertBuf(layout, len(mesh.loops))
    for name, array in arrays.items():
        vertices.attr_fill(name, np.ascontiguousarray(array))
    batches = tuple(
        (
            int(slot),
            gpu.types.GPUBatch(
                type="TRIS",
                buf=vertices,
                elem=gpu.types.GPUIndexBuf(
                    type="TRIS", seq=np.ascontiguousarray(triangles[slots == slot])
                ),
            ),
        )
        for slot in np.unique(slots)
    )
    points = arrays["position"]
    return MeshBatches(batches, np.stack([points.min(0), points.max(0)]))


def _cut_large_faces(mesh: bpy.types.Mesh) -> None:
    shape = bmesh.new()
    shape.from_mesh(mesh)
    large = [face for face in shape.faces if len(face.verts) > LARGEST_TANGENT_FACE]
    bmesh.ops.triangulate(shape, faces=large)
    shape.to_mesh(mesh)
    shape.free()


def _read(collection, attribute: str, length: int) -> np.ndarray:
    values = np.empty(len(collection) * length, np.float32)
    collection.foreach_get(attribute, values)
    return values.reshape(-1, length)
