"""Patches of a dataset, the data points of SparseBTF: a few texels for all lights and views."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import prod

import numpy as np
from numpy.typing import NDArray

from ...datasets.dataset import Dataset
from .transform import CHANNELS, Normalisation

Origin = tuple[int, int]
"""The lower left texel (y, x) of a patch."""

BLOCK = 2**25
"""Values of patches in memory at a time, where patches are smaller."""

_Indices = slice | NDArray[np.intp]


def tiling(height: int, width: int, patch: tuple[int, int]) -> list[Origin]:
    """Origins of patches side by side that cover all texels, row by row; the last of a row or a
    column may reach over the edge."""
    return [(y, x) for y in range(0, height, patch[0]) for x in range(0, width, patch[1])]


def overlapping(dataset: Dataset, patch: tuple[int, int]) -> list[Origin]:
    """Origins half a patch apart, for training: around the edges of a periodic dataset, up to them
    otherwise."""
    sizes = (dataset.sizes["y"], dataset.sizes["x"])
    ys, xs = (
        range(0, size if dataset.periodic else max(1, size - side + 1), max(1, side // 2))
        for size, side in zip(sizes, patch, strict=True)
    )
    return [(y, x) for y in ys for x in xs]


def read_patches(
    dataset: Dataset,
    normalised: Normalisation,
    patch: tuple[int, int],
    origins: Sequence[Origin],
    block: int = BLOCK,
) -> Iterator[tuple[slice, NDArray[np.float32]]]:
    """Normalised patches (n, y, x, light, view, 3) float32 in the order of `origins`, with their
    places in it; up to `block` values at a time, but one patch. Over the edges a periodic dataset
    goes on at the other side, and texels of another are those at the edge."""
    lights, views, height, width, _ = dataset.shape
    most = max(1, block // (3 * lights * views * prod(patch)))
    first = 0
    while first < len(origins):
        y = origins[first][0]
        end = first + 1
        while end < len(origins) and end - first < most and origins[end][0] == y:
            end += 1
        rows = indices_inside(y, patch[0], height, dataset.periodic)
        found = np.empty((end - first, *patch, lights, views, 3), np.float32)
        for values, (_, x) in zip(found, origins[first:end], strict=True):
            columns = indices_inside(x, patch[1], width, dataset.periodic)
            window = normalised.code(_window(dataset.samples, rows, columns))
            values[...] = np.moveaxis(window, (0, 1), (2, 3))
        yield slice(first, end), found
        first = end


def channels_of(patches: NDArray[np.float32], key: str) -> NDArray[np.float32]:
    """The channels that a part of an ensemble is for: (n, y, x, light, view) of "Y", "U" or "V",
    with a mode of its own for the colour of "YUV"."""
    if len(key) > 1:
        return np.ascontiguousarray(patches)
    return np.ascontiguousarray(patches[..., CHANNELS.index(key)])


def indices_inside(first: int, count: int, size: int, periodic: bool) -> _Indices:
    """The `count` texels from the one numbered `first` on along an axis, over its end or not."""
    if first + count <= size:
        return slice(first, first + count)
    indices = np.arange(first, first + count)
    return indices % size if periodic else np.minimum(indices, size - 1)


def _window(
    samples: NDArray[np.floating], rows: _Indices, columns: _Indices
) -> NDArray[np.floating]:
    """Some texels; of an axis that is sliced no more is read."""
    if isinstance(columns, slice):
        return samples[:, :, :, columns][:, :, rows]
    if isinstance(rows, slice):
        return samples[:, :, rows][:, :, :, columns]
    return samples[:, :, rows[:, None], columns]
