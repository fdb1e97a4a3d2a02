"""The camera that sees a patch from many directions in one render."""

from __future__ import annotations

import bpy
import numpy as np

from ..osl import compile_osl
from .cycles import render
from .tiles import Tiles

SHADER = "hemisphere_camera.osl"


class HemisphereCamera:
    """All of `view` (V, 3) as the tiles of one picture, taken from the scene's origin.

    `patch` is the size (width, height) of the patch in metres; rays start at `height` above the
    plane. `centred` sends every ray through its texel's centre.
    """

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
        scene.render.resolution_x, scene.render.resolution_y = tiles.picture_size
        _add_camera(scene, view, tiles, patch, height, centred)

    def take(self, seed: int, row: int | None) -> np.ndarray:
        """Linear RGB and coverage (view, y, x, 4) of all views or of one row of tiles."""
        rows = self._tiles.rows
        strip = (0.0, 1.0) if row is None else (row / rows, (row + 1) / rows)
        return self._tiles.split(render(self._scene, seed, strip)["Combined"], row)


def _add_camera(
    scene: bpy.types.Scene,
    view: np.ndarray,
    tiles: Tiles,
    patch: tuple[float, float],
    height: float,
    centred: bool,
) -> None:
    start = height / view[:, 2]
    values = {
        "VIEWS": tiles.count,
        "VIEW_X": _list(view[:, 0]),
        "VIEW_Y": _list(view[:, 1]),
        "VIEW_Z": _list(view[:, 2]),
        "VIEW_START": _list(start),
        "COLUMNS": tiles.columns,
        "ROWS": tiles.rows,
        "TEXELS_X": tiles.texels[0],
        "TEXELS_Y": tiles.texels[1],
        "PATCH_X": f"{patch[0]:.9g}",
        "PATCH_Y": f"{patch[1]:.9g}",
        "CENTRED": int(centred),
    }
    header = "".join(f"#define {name} {value}\n" for name, value in values.items())
    bytecode, stamp = compile_osl(SHADER, "hemisphere_views.h", header)
    camera = bpy.data.cameras.new("Hemisphere")
    camera.type = "CUSTOM"
    camera.custom_bytecode = bytecode
    camera.custom_bytecode_hash = stamp
    # Rays start above everything, wherever that is.
    camera.clip_start = 1e-6
    camera.clip_end = 4.0 * float(start.max())
    item = bpy.data.objects.new("Hemisphere", camera)
    scene.collection.objects.link(item)
    scene.camera = item


def _list(values: np.ndarray) -> str:
    return ", ".join(f"{value:.9g}" for value in values)
