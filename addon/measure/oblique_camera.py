"""One view after the other, for a Blender without the Open Shading Language.

An orthographic camera whose matrix is sheared: its picture plane stays the reference plane while
it looks along any direction, so that a texel is the same piece of the plane in every view. Blender
keeps the shear of a camera only when it comes from its parent. A picture costs some 10 ms more than
its rays, which is why all views in one are better where that can be had.
"""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix

from .cycles import render
from .tiles import Tiles

# Blender renders no picture of less than 4 pixels in width or height; of smaller patches as many
# are taken as it needs, the one in the middle being the right one.
_LEAST = 4


class ObliqueCamera:
    """Each of `view` (V, 3) as a picture; arguments as of HemisphereCamera."""

    def __init__(
        self,
        scene: bpy.types.Scene,
        view: np.ndarray,
        tiles: Tiles,
        patch: tuple[float, float],
        height: float,
        centred: bool,
    ) -> None:
        self._scene, self._tiles = scene, tiles
        start = height / view[:, 2]
        self._matrices = [_matrix(w, far) for w, far in zip(view, start, strict=True)]
        self._copies = next(n for n in (1, 3, 5) if n * min(tiles.texels) >= _LEAST)
        width, depth = (n * self._copies for n in tiles.texels)
        scene.render.resolution_x, scene.render.resolution_y = width, depth
        size = patch[0] * self._copies, patch[1] * self._copies
        self._camera = add_orthographic(scene, size, 4.0 * float(start.max()))
        self._camera.parent = bpy.data.objects.new("Shear", None)
        scene.collection.objects.link(self._camera.parent)
        if centred:  # the narrowest filter there is
            scene.cycles.pixel_filter_type, scene.cycles.filter_width = "GAUSSIAN", 0.01

    def take(self, seed: int, row: int | None) -> np.ndarray:
        """Linear RGB and coverage (view, y, x, 4) of all views or of one row of tiles."""
        views = range(self._tiles.count)[self._tiles.views(row)]
        return np.stack([self._take_one(seed, view) for view in views])

    def _take_one(self, seed: int, view: int) -> np.ndarray:
        self._camera.matrix_parent_inverse = self._matrices[view]
        # Each has a seed of its own, in the range of Cycles' seeds.
        picture = render(self._scene, (seed * self._tiles.count + view) % 2**31)["Combined"]
        width, height = self._tiles.texels
        x, y = (self._copies // 2 * side for side in (width, height))
        return picture[y : y + height, x : x + width]


def add_orthographic(
    scene: bpy.types.Scene, size: tuple[float, float], reach: float
) -> bpy.types.Object:
    """Give the scene a camera that frames `size` (width, height) in metres in the scene's
    resolution, and sees as far as `reach`; it sits at the origin and looks down."""
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.sensor_fit, camera.ortho_scale = "ORTHO", "HORIZONTAL", size[0]
    camera.clip_start, camera.clip_end = 1e-6, reach
    item = bpy.data.objects.new("Camera", camera)
    scene.collection.objects.link(item)
    scene.camera = item
    # Texels are not quite square where the patch is no whole number of them high.
    settings = scene.render
    aspect = size[1] * settings.resolution_x / (size[0] * settings.resolution_y)
    settings.pixel_aspect_x, settings.pixel_aspect_y = max(1.0, 1 / aspect), max(1.0, aspect)
    return item


def _matrix(view: np.ndarray, start: float) -> Matrix:
    """x and y along the plane, z towards the viewer, from where the rays start."""
    x, y, z = view
    return Matrix(((1, 0, x, start * x), (0, 1, y, start * y), (0, 0, z, start * z), (0, 0, 0, 1)))
