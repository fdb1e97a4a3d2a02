"""Coarse patches of a sparse model, for pixels that are larger than a patch.

The mean of a patch is a sum over its coefficients too, each times the mean of its row of texels, so
what remains is a product of a light row and a view row; and the mean of several patches is the sum
of all of those. The largest are kept, as many as a patch has. It is a mean of logarithms.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .levels import halve

if TYPE_CHECKING:  # models need the compiled packages, and the engine registers without
    from .sparse_tables import Part

ROOM = 2
"""A coarse patch may use so many times the rows that a patch does, as its patches use different
ones."""


def patch_levels(up: int, across: int) -> tuple[tuple[int, int], ...]:
    """Numbers of patches, halved down to one."""
    sizes = [(up, across)]
    while sizes[-1] != (1, 1):
        sizes.append((max(1, sizes[-1][0] // 2), max(1, sizes[-1][1] // 2)))
    return tuple(sizes)


def all_patches(part: Part) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The coefficients (patches of all levels, count, 4) of a part, the finest level first, and its
    rows of texels with one more, of ones, that coarse patches use."""
    count, up, across, _ = part.coefficients.shape
    table = part.coefficients.reshape(count, -1, 4).swapaxes(0, 1)
    texels = np.concatenate([part.texels, np.ones_like(part.texels[:1])])
    views = len(part.view)
    most = [ROOM * _most_rows(table, column) for column in (2, 3)]
    texel, light, view = (table[..., column].astype(np.intp) for column in (1, 2, 3))
    # The mean of a row over a whole patch: 1 for those of coarse patches.
    values = table[..., 0] * part.texels.mean((1, 2))[texel]
    keys = light * views + view
    found = [table]
    sizes = patch_levels(up, across)
    for size, coarser in zip(sizes, sizes[1:], strict=False):
        shares = [halve(np.eye(n, dtype=np.float32), 0) if n > 1 else np.ones((1, 1)) for n in size]
        children = np.arange(len(values)).reshape(size)
        kept = np.zeros((coarser[0] * coarser[1], count), np.float32)
        places = np.zeros(kept.shape, np.intp)
        for number, (y, x) in enumerate(np.ndindex(coarser)):
            share = np.outer(shares[0][y], shares[1][x])
            own = children[share > 0]
            weighted = values[own] * share[share > 0][:, None]
            pairs, which = np.unique(keys[own], return_inverse=True)
            sums = np.bincount(which.ravel(), weighted.ravel())
            for row, room in zip(np.divmod(pairs, views), most, strict=True):
                sums[_weak(row, sums, room)] = 0.0
            largest = np.argsort(-np.abs(sums), kind="stable")[:count]
            kept[number, : len(largest)] = sums[largest]
            places[number, : len(largest)] = pairs[largest]
        values, keys = kept, places
        ones = np.full(kept.shape, len(part.texels))
        level = np.stack([kept, ones, *np.divmod(places, views)], -1).astype(np.float32)
        found.append(level)
    return np.concatenate(found), texels


def _most_rows(table: NDArray[np.float32], column: int) -> int:
    """Of different rows in a patch."""
    used = [len(np.unique(own[own[:, 0] != 0, column])) for own in table]
    return max(1, *used)


def _weak(rows: NDArray[np.intp], sums: NDArray[np.floating], room: int) -> NDArray[np.bool_]:
    """Which sums are of none of the `room` rows that have most of the energy."""
    energy = np.bincount(rows, sums**2)
    strong = np.argsort(-energy, kind="stable")[:room]
    return ~np.isin(rows, strong)
