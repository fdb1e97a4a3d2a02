"""The camera that sees a patch from many directions in one render (shaders/hemisphere_camera.osl).

Its shader is compiled here, and not by Blender's operator, which asks oslquery for the shader's
parameters: the bpy wheel cannot import that module, and there are no parameters to ask for.
"""

from __future__ import annotations

import hashlib
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ..errors import NacreError
from ..shader_files import shader_text

SHADER = "hemisphere_camera.osl"


@dataclass(frozen=True)
class Tiles:
    """How the views lie in a picture: `count` tiles of texels (x, y), row by row from the bottom
    left."""

    count: int
    texels: tuple[int, int]

    # Blender renders no picture of less than 4 pixels in width or height.

    @property
    def columns(self) -> int:
        return max(math.ceil(math.sqrt(self.count)), math.ceil(4 / self.texels[0]))

    @property
    def rows(self) -> int:
        return max(math.ceil(self.count / self.columns), math.ceil(4 / self.texels[1]))

    @property
    def picture_size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.columns * self.texels[0], self.rows * self.texels[1]

    def views(self, row: int | None = None) -> slice:
        """The views in a row of tiles; all views without one."""
        if row is None:
            return slice(0, self.count)
        return slice(row * self.columns, min((row + 1) * self.columns, self.count))

    @property
    def used_rows(self) -> int:
        """Rows that hold a view."""
        return math.ceil(self.count / self.columns)

    def split(self, picture: np.ndarray, row: int | None = None) -> np.ndarray:
        """(view, y, x, channel) from a picture (height, width, channel), bottom row first, of all
        views or of one row of tiles."""
        width, height = self.texels
        tiles = picture.reshape(-1, height, self.columns, width, picture.shape[-1])
        tiles = tiles.transpose(0, 2, 1, 3, 4).reshape(-1, height, width, picture.shape[-1])
        views = self.views(row)
        return tiles[: views.stop - views.start]


def add_hemisphere_camera(
    scene: bpy.types.Scene,
    view: np.ndarray,
    tiles: Tiles,
    patch: tuple[float, float],
    height: float,
    centred: bool = False,
) -> None:
    """Give the scene a camera at the origin that looks from all of `view` (V, 3) at once.

    `patch` is the size (width, height) of the patch in metres; rays start at `height` above the
    plane.
    `centred` sends every ray through its texel's centre. Raises NacreError where this Blender
    cannot compile the shader.
    """
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
    bytecode = _compile(header)
    camera = bpy.data.cameras.new("Hemisphere")
    camera.type = "CUSTOM"
    camera.custom_bytecode = bytecode
    camera.custom_bytecode_hash = hashlib.md5(bytecode.encode(), usedforsecurity=False).hexdigest()
    # Rays start above everything, wherever that is.
    camera.clip_start = 1e-6
    camera.clip_end = 4.0 * float(start.max())
    item = bpy.data.objects.new("Hemisphere", camera)
    scene.collection.objects.link(item)
    scene.camera = item


def _list(values: np.ndarray) -> str:
    return ", ".join(f"{value:.9g}" for value in values)


def _compile(header: str) -> str:
    import _cycles

    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / SHADER, Path(folder) / "camera.oso"
        source.write_text(shader_text(SHADER), encoding="utf-8")
        (Path(folder) / "hemisphere_views.h").write_text(header, encoding="utf-8")
        if not getattr(_cycles, "with_osl", False) or not _cycles.osl_compile(
            str(source), str(target)
        ):
            raise NacreError("this Blender cannot compile OSL cameras, which measuring needs")
        return target.read_text(encoding="utf-8")
