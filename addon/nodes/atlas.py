"""Tables as tiles of one image, since a shader node tree cannot index images."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, sqrt

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import NacreError

LARGEST = 16384
"""Texels along the largest texture that graphics drivers commonly take."""


@dataclass(frozen=True)
class Atlas:
    """An image of equal tiles; tile (column, row) begins at (column / columns, row / rows)."""

    image: bpy.types.Image
    columns: int
    rows: int
    block_columns: int

    @property
    def scale(self) -> tuple[float, float, float]:
        """The size of one tile in the image's texture coordinates."""
        return 1.0 / self.columns, 1.0 / self.rows, 0.0

    def offset(self, tile: int) -> tuple[float, float, float]:
        """Where a tile begins within its block."""
        row, column = divmod(tile, self.block_columns)
        return column / self.columns, row / self.rows, 0.0


def make_atlas(name: str, blocks: NDArray[np.float32]) -> tuple[Atlas, NDArray[np.float32]]:
    """Lay out blocks (blocks, tiles, Y, X, 4) in a packed image.

    Returns the atlas and each block's origin (blocks, 2) in texture coordinates. Raises NacreError
    when no layout fits the largest texture.
    """
    count, tiles, height, width, _ = blocks.shape
    # Each block's tiles form a rectangle, and the rectangles another, both as square as they can.
    block_columns = max(1, min(tiles, round(sqrt(tiles * height / width))))
    block_rows = ceil(tiles / block_columns)
    across = max(1, min(count, round(sqrt(count * block_rows * height / (block_columns * width)))))
    down = ceil(count / across)
    columns, rows = across * block_columns, down * block_rows
    if max(columns * width, rows * height) > LARGEST:
        raise NacreError(
            f"{name}: its tables need a texture of {columns * width} x {rows * height} texels and "
            f"{LARGEST} is the limit; compress with fewer clusters or lower ranks"
        )
    grid = np.zeros((down * across, block_rows * block_columns, height, width, 4), np.float32)
    grid[:count, :tiles] = blocks
    grid = grid.reshape(down, across, block_rows, block_columns, height, width, 4)
    pixels = grid.transpose(0, 2, 4, 1, 3, 5, 6).reshape(rows * height, columns * width, 4)
    block = np.arange(count)
    origins = np.column_stack([block % across / across, block // across / down])
    image = make_image(name, pixels)
    return Atlas(image, columns, rows, block_columns), origins.astype(np.float32)


def make_image(name: str, pixels: NDArray[np.float32]) -> bpy.types.Image:
    """A packed float image of data (height, width, 4), bottom row first."""
    height, width, _ = pixels.shape
    image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=True, is_data=True)
    image.alpha_mode = "CHANNEL_PACKED"  # else colour would be divided by alpha
    image.use_half_precision = False
    image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).ravel())
    image.pack()
    return image
