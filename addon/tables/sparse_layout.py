"""Sparse tables as textures hold them: every row is fetched once a point, whatever uses it.

A patch's coefficients use few rows of each kind, each of them many times. So a patch lists the
quads of rows that it uses, a shader keeps these in arrays, and coefficients name places there:
with c coefficients and q quads a point takes c + q fetches and not 4 c. The sums by light row do
not depend on the light, of which each then takes a fetch for each quad of light rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .levels import halve

if TYPE_CHECKING:  # models need the compiled packages, and the engine registers without
    from .sparse_tables import Part, SparseTables

HEADER = 2
"""Texels that begin a part's list."""

ROUNDED = 4
"""Lengths of a shader's arrays are whole multiples of this many quads, so that models of about the
same size share a shader."""


@dataclass(frozen=True)
class SparseLayout:
    """Textures of (layers, height, width, 4) float32.

    coefficients (patches up, patches across, columns, 4): value, and its places among the rows of
                 texels, light and view that the patch lists; of all parts one after the other,
                 those of one light row together; a part has one at least, which may be 0
    lists        (patches up, patches across, columns, 4): for each part (first coefficient, their
                 number, first column of its list, 0) and the numbers of quads of (texels, light,
                 view, 0); then the lists, layers of (texels, light, view, 0)
    texels       (quads, 1, texels, 4): rows over the texels of a patch, the finest level first
    light, view  (quads, N, N, 4): rows by parabolic texel, then the maps of mean and deviation
    levels       (height, width) of a patch in each level; levels average rows, which is an average
                 of logarithms
    images       quads of the mean, and of the deviation
    height, width, lowest, offset  as in SparseTables
    longest      most quads of texels and of views in a part of a patch, and of lights in all parts
    """

    coefficients: NDArray[np.float32]
    lists: NDArray[np.float32]
    texels: NDArray[np.float32]
    light: NDArray[np.float32]
    view: NDArray[np.float32]
    levels: tuple[tuple[int, int], ...]
    images: tuple[int, int]
    longest: tuple[int, int, int]
    height: int
    width: int
    lowest: float
    offset: float


def sparse_layout(tables: SparseTables) -> SparseLayout:
    """Sparse tables laid out for textures."""
    parts = list(tables.parts.values())
    up, across = parts[0].coefficients.shape[1:3]
    rows = [(part.texels, part.light, part.view) for part in parts]
    quads = np.array([[-(-len(own) // 4) for own in kinds] for kinds in rows])
    before = np.cumsum(quads, 0) - quads
    listed = [_listed(part, first) for part, first in zip(parts, before, strict=True)]
    counts = np.array([one.counts for one in listed])
    coefficients = np.concatenate([one.coefficients for one in listed], 1)
    lists, heads = [], []
    first_coefficient, first_column = 0, HEADER * len(parts)
    lights = np.zeros(up * across, np.float32)
    for one, count in zip(listed, counts, strict=True):
        # Light rows of all parts stay in one array until a light comes.
        begin = slice(first_coefficient, first_coefficient + one.coefficients.shape[1])
        coefficients[:, begin, 2] += 4 * lights[:, None]
        head = np.zeros((len(count), HEADER, 4), np.float32)
        head[:, 0, :3] = np.stack(
            np.broadcast_arrays(first_coefficient, one.used, first_column), -1
        )
        head[:, 1, :3] = count
        heads.append(head)
        lists.append(one.lists)
        lights += count[:, 1]
        first_coefficient = begin.stop
        first_column += one.lists.shape[1]
    levels = _levels(tables.patch)
    images = (len(tables.mean.light), len(tables.deviation.light))

    def maps(kind: int, mean: NDArray[np.float32], deviation: NDArray[np.float32]):
        own = [_quads(kinds[kind]) for kinds in rows]
        return np.concatenate([*own, mean, deviation])

    return SparseLayout(
        coefficients=coefficients.reshape(up, across, -1, 4),
        lists=np.concatenate([*heads, *lists], 1).reshape(up, across, -1, 4),
        texels=np.concatenate([_texels(part.texels, levels) for part in parts])[:, None],
        light=maps(1, tables.mean.light, tables.deviation.light),
        view=maps(2, tables.mean.view, tables.deviation.view),
        levels=levels,
        images=images,
        longest=(
            _rounded(counts[..., 0].max()),
            _rounded(counts[..., 1].sum(0).max()),
            _rounded(counts[..., 2].max()),
        ),
        height=tables.height,
        width=tables.width,
        lowest=tables.lowest,
        offset=tables.offset,
    )


@dataclass(frozen=True)
class _Listed:
    """One part: coefficients (patches, count, 4), those in use (patches,), lists (patches, longest,
    4) and the lists' lengths (patches, 3)."""

    coefficients: NDArray[np.float32]
    used: NDArray[np.intp]
    lists: NDArray[np.float32]
    counts: NDArray[np.intp]


def _listed(part: Part, first: NDArray[np.intp]) -> _Listed:
    table = part.coefficients.reshape(len(part.coefficients), -1, 4).swapaxes(0, 1)
    nonzero = table[..., 0] != 0
    # Zeros last, light rows together: a shader sums up to the end of each.
    order = np.lexsort((table[..., 2], ~nonzero), axis=1)
    table = np.take_along_axis(table, order[..., None], 1).copy()
    nonzero = table[..., 0] != 0
    kinds = (part.texels, part.light, part.view)
    patch = np.broadcast_to(np.arange(len(table))[:, None], nonzero.shape)
    lists, counts = [], []
    for kind, rows in enumerate(kinds, 1):
        quads = -(-len(rows) // 4)
        row = table[..., kind].astype(np.intp)
        uses = np.zeros((len(table), quads), bool)
        uses[patch[nonzero], row[nonzero] // 4] = True
        place = np.cumsum(uses, 1) - 1
        count = np.maximum(uses.sum(1), 1)
        table[..., kind] = np.where(nonzero, 4 * place[patch, row // 4] + row % 4, 0)
        own = np.argsort(~uses, axis=1, kind="stable")[:, : count.max()]
        lists.append(own + first[kind - 1])
        counts.append(count)
    longest = max(own.shape[1] for own in lists)
    columns = np.zeros((len(table), longest, 4), np.float32)
    for kind, own in enumerate(lists):
        columns[:, : own.shape[1], kind] = own
    return _Listed(table, np.maximum(nonzero.sum(1), 1), columns, np.stack(counts, -1))


def _levels(patch: tuple[int, int]) -> tuple[tuple[int, int], ...]:
    """Sizes of a patch, halved down to one texel."""
    sizes = [patch]
    while sizes[-1] != (1, 1):
        sizes.append((max(1, sizes[-1][0] // 2), max(1, sizes[-1][1] // 2)))
    return tuple(sizes)


def _texels(rows: NDArray[np.float32], levels: tuple[tuple[int, int], ...]) -> NDArray[np.float32]:
    """Rows (n, h, w) as quads (n / 4, texels of all levels, 4)."""
    found = [rows.reshape(len(rows), -1)]
    for size in levels[1:]:
        for axis, length in enumerate(size, 1):
            rows = halve(rows, axis) if rows.shape[axis] != length else rows
        found.append(rows.reshape(len(rows), -1))
    return _quads(np.concatenate(found, 1))


def _quads(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Rows (n, ...) in quads (n / 4, ..., 4), filled up with zeros."""
    filled = np.pad(rows, ((0, -len(rows) % 4), *((0, 0),) * (rows.ndim - 1)))
    return np.moveaxis(filled.reshape(-1, 4, *rows.shape[1:]), 1, -1)


def _rounded(quads: int) -> int:
    return max(1, -(-int(quads) // ROUNDED)) * ROUNDED
