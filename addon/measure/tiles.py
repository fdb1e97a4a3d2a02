"""How all views lie in one picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


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
