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
    """An image of blocks in a grid (across, up), each a rectangle of equal tiles.

    Block (i, j) begins at (i / across, j / up) in texture coordinates, whatever it holds: clusters
    can be looked up as such fractions that serve several atlases.
    """

    image: bpy.types.Image
    across: int
    up: int
    columns: int
    rows: int

    @property
    def scale(self) -> tuple[float, float, float]:
        """The size of one tile in the image's texture coordinates."""
        return 1.0 / (self.across * self.columns), 1.0 / (self.up * self.rows), 0.0


def make_atlas(name: str, blocks: NDArray[np.float32]) -> Atlas:
    """Lay out blocks (across, up, tiles, Y, X, 4) in a packed image.

    Raises NacreError when that does not fit the largest texture.
    """
    pixels, columns, rows = lay_out(name, blocks)
    return Atlas(make_image(name, pixels), *blocks.shape[:2], columns, rows)


def lay_out(name: str, blocks: NDArray[np.float32]) -> tuple[NDArray[np.float32], int, int]:
    """The pixels of make_atlas, and the columns and rows of tiles in a block."""
    across, up, tiles, height, width, _ = blocks.shape
    # Tiles of a block form the rectangle that makes the whole as square as it can be.
    columns = max(1, min(tiles, round(sqrt(tiles * height * up / (width * across)))))
    columns = min(columns, max(1, LARGEST // (across * width)))
    rows = ceil(tiles / columns)
    if max(across * columns * width, up * rows * height) > LARGEST:
        raise NacreError(
            f"{name}: its tables need a texture of {across * columns * width} x "
            f"{up * rows * height} texels and {LARGEST} is the limit; compress it to a "
            "smaller model"
        )
    grid = np.zeros((across, up, rows * columns, height, width, 4), np.float32)
    grid[:, :, :tiles] = blocks
    grid = grid.reshape(across, up, rows, columns, height, width, 4)
    pixels = grid.transpose(1, 2, 4, 0, 3, 5, 6).reshape(
        up * rows * height, across * columns * width, 4
    )
    return pixels, columns, rows


def cut_out(atlas: Atlas, tiles: int, height: int, width: int) -> NDArray[np.float32]:
    """What make_atlas laid out: blocks (across, up, tiles, Y, X, 4)."""
    pixels = np.empty(atlas.image.size[0] * atlas.image.size[1] * 4, np.float32)
    atlas.image.pixels.foreach_get(pixels)
    grid = pixels.reshape(atlas.up, atlas.rows, height, atlas.across, atlas.columns, width, 4)
    blocks = grid.transpose(3, 0, 1, 4, 2, 5, 6)
    return blocks.reshape(atlas.across, atlas.up, -1, height, width, 4)[:, :, :tiles]


def make_image(name: str, pixels: NDArray[np.float32]) -> bpy.types.Image:
    """A packed float image of data (height, width, 4), bottom row first."""
    height, width, _ = pixels.shape
    image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=True, is_data=True)
    image.alpha_mode = "CHANNEL_PACKED"  # else colour would be divided by alpha
    image.use_half_precision = False
    image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).ravel())
    image.pack()
    return image
