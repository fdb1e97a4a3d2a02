"""How large a UV map lays a texture on an object."""

from __future__ import annotations

import bpy
import numpy as np

from ..errors import NacreError


def metres_of_uv(item: bpy.types.Object) -> float:
    """Metres on an object, its scale included, for one unit of its active UV map: the root of the
    ratio of areas, over the triangles that have both. Raises NacreError when none has."""
    mesh = item.data
    layer = mesh.uv_layers.active
    if layer is None:
        raise NacreError(f"{item.name} has no UV map: unwrap it first")
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    corners, vertices = np.empty(3 * count, np.intp), np.empty(3 * count, np.intp)
    mesh.loop_triangles.foreach_get("loops", corners)
    mesh.loop_triangles.foreach_get("vertices", vertices)
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    uvs = np.empty(2 * len(mesh.loops), np.float32)
    layer.uv.foreach_get("vector", uvs)
    turned = points.reshape(-1, 3) @ np.array(item.matrix_world.to_3x3()).T
    a, b, c = turned[vertices.reshape(-1, 3)].swapaxes(0, 1)
    on_object = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=-1)
    p, q, r = uvs.reshape(-1, 2)[corners.reshape(-1, 3)].swapaxes(0, 1)
    (x1, y1), (x2, y2) = (q - p).T, (r - p).T
    in_map = 0.5 * np.abs(x1 * y2 - x2 * y1)
    both = (on_object > 0.0) & (in_map > 0.0)
    if not both.any():
        raise NacreError(f"the UV map of {item.name} has no area: unwrap it again")
    return float(np.sqrt(on_object[both].sum() / in_map[both].sum()))
