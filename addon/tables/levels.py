"""Levels of the core for the distance: textures that hold every size at once.

Textures and images of Blender's Python take no mip levels, so the whole core quad and its halved
copies (Williams 1983) stand side by side: in each layer of the GLSL engine's texture array, and in
each tile of the shader nodes' image (`levels_beside`). In a layer a border of one texel repeats the
other side of the patch, so that bilinear filtering inside a region never reads its neighbour.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

BORDER = 1
"""Texels round a region that repeat its other side."""


@dataclass(frozen=True)
class Regions:
    """Where the levels lie in a layer: (x, y, width, height) of each, borders left out, the finest
    first; `shape` is the layer's (height, width)."""

    places: tuple[tuple[int, int, int, int], ...]
    shape: tuple[int, int]


def regions(height: int, width: int) -> Regions:
    """The finest level on the left and all others stacked beside it, down to one texel."""
    places, x, y = [], 0, 0
    sizes = [(height, width)]
    while sizes[-1] != (1, 1):
        sizes.append((max(1, sizes[-1][0] // 2), max(1, sizes[-1][1] // 2)))
    for number, (high, wide) in enumerate(sizes):
        places.append((x + BORDER, y + BORDER, wide, high))
        if number == 0:
            x = wide + 2 * BORDER
        else:
            y += high + 2 * BORDER
    across = x + (sizes[1][1] + 2 * BORDER if len(sizes) > 1 else 0)
    return Regions(tuple(places), (max(height + 2 * BORDER, y), across))


def halve(texels: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    """A periodic axis of n texels averaged over n // 2 (at least one) equal boxes.

    The boxes of an odd size take parts of texels, so that every texel weighs the same.
    """
    size = texels.shape[axis]
    count = max(1, size // 2)
    low = np.arange(count)[:, None] * (size / count)
    texel = np.arange(size)[None]
    weights = np.clip(np.minimum(low + size / count, texel + 1) - np.maximum(low, texel), 0.0, None)
    weights = (weights * (count / size)).astype(np.float32)
    return np.moveaxis(np.tensordot(weights, texels, (1, axis)), 0, axis)


def layers_of_levels(core: NDArray[np.float32]) -> NDArray[np.float32]:
    """A core (..., Y, X, 4) as layers (blocks, height, width, 4) laid out by `regions`; blocks in
    the order of the leading axes."""
    level = core.reshape(-1, *core.shape[-3:])
    layout = regions(*level.shape[1:3])
    layers = np.zeros((len(level), *layout.shape, 4), np.float32)
    for number, (x, y, wide, high) in enumerate(layout.places):
        if number:
            for axis, size in ((1, high), (2, wide)):
                level = halve(level, axis) if level.shape[axis] != size else level
        rows = slice(y - BORDER, y + high + BORDER)
        columns = slice(x - BORDER, x + wide + BORDER)
        pad = ((0, 0), (BORDER, BORDER), (BORDER, BORDER), (0, 0))
        layers[:, rows, columns] = np.pad(level, pad, mode="wrap")
    return layers


def count_beside(height: int, width: int) -> int:
    """How many halved copies `levels_beside` has, none of them narrower than a texel."""
    return min(height, width).bit_length() - 1


def levels_beside(core: NDArray[np.float32]) -> NDArray[np.float32]:
    """A core (..., Y, X, 4) with its halved copies in a column beside it: (..., Y, X + X // 2, 4).

    Copy n has Y // 2^n rows and X // 2^n columns and begins in row floor(Y (1 - 2^(1 - n))), so
    that a shader works out where it is. Without borders: a shader's four taps wrap one by one.
    """
    *_, height, width, _ = core.shape
    beside = np.zeros((*core.shape[:-2], width + width // 2, 4), np.float32)
    beside[..., :width, :] = level = core
    for number in range(1, count_beside(height, width) + 1):
        high, wide = height >> number, width >> number
        level = halve(halve(level, core.ndim - 3), core.ndim - 2)
        row = height - -(-height * 2 // 2**number)
        beside[..., row : row + high, width : width + wide, :] = level
    return beside
