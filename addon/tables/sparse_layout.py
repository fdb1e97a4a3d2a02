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

from ..errors import NacreError
from .levels import halve
from .sparse_levels import all_patches, patch_levels

if TYPE_CHECKING:  # models need the compiled packages, and the engine registers without
    from .sparse_tables import SparseTables

HEADER = 2
"""Texels that begin a part's list."""

BLENDED = 4
"""Materials in a blend: their weights are one RGBA texel."""

ROUNDED = 8
"""Lengths of a shader's arrays are whole multiples of this many quads, so that models of about the
same size share a shader."""


@dataclass(frozen=True)
class SparseLayout:
    """Textures of (layers, height, width, 4) float32, of one material or several.

    coefficients (rows, patches across, columns, 4): for all patches, those of coarser levels
                 (sparse_levels) after the others: value, and its places among the rows of
                 texels, light and view that the patch lists; of all parts one after the other,
                 those of one light row together; a part has one at least, which may be 0
    lists        (rows, patches across, columns, 4): for each part (first coefficient, their
                 number, first column of its list, 0) and the numbers of quads of (texels, light,
                 view, 0); then the lists, layers of (texels, light, view, 0)
    texels       (quads, 1, texels, 4): rows over the texels of a patch, the finest level first
    light, view  (quads, N, N, 4): rows by parabolic texel, then the maps of mean and deviation
    levels       (height, width) of a patch in each level; levels average rows, which is an average
                 of logarithms
    images       of each material, quads of the mean, and of the deviation
    height, width, lowest, offset  as in SparseTables
    longest      most quads of texels and of views in a part of a patch, and of lights in all parts
    """

    coefficients: NDArray[np.float32]
    lists: NDArray[np.float32]
    texels: NDArray[np.float32]
    light: NDArray[np.float32]
    view: NDArray[np.float32]
    levels: tuple[tuple[int, int], ...]
    patches: tuple[tuple[int, int], ...]
    images: tuple[tuple[int, int], ...]
    longest: tuple[int, int, int]
    height: int
    width: int
    lowest: float
    offset: float


def sparse_layout(*materials: SparseTables) -> SparseLayout:
    """Sparse tables laid out for textures; of several materials for a blend.

    Raises NacreError for materials that cannot be blended.
    """
    tables = materials[0]
    for number, other in enumerate(materials[1:], 2):
        for name in ("height", "width", "patch", "size", "offset", "lowest"):
            if getattr(other, name) != getattr(tables, name):
                raise NacreError(
                    f"material {number} cannot be blended with material 1: {name} "
                    f"{getattr(other, name)}, not {getattr(tables, name)}"
                )
    if len(materials) > BLENDED:
        raise NacreError(f"{len(materials)} materials: a blend is drawn of {BLENDED} at most")
    parts = [part for one in materials for part in one.parts.values()]
    up, across = parts[0].coefficients.shape[1:3]
    coded, texels = zip(*(all_patches(part) for part in parts), strict=True)
    rows = [(own, part.light, part.view) for own, part in zip(texels, parts, strict=True)]
    quads = np.array([[-(-len(own) // 4) for own in kinds] for kinds in rows])
    before = np.cumsum(quads, 0) - quads
    listed = [
        _listed(table, kinds, first)
        for table, kinds, first in zip(coded, rows, before, strict=True)
    ]
    counts = np.array([one.counts for one in listed])
    coefficients = np.concatenate([one.coefficients for one in listed], 1)
    lists, heads = [], []
    first_coefficient, first_column = 0, HEADER * len(parts)
    lights = np.zeros(len(coefficients), np.float32)
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
    images = [image for one in materials for image in (one.mean, one.deviation)]

    def maps(name: str) -> NDArray[np.float32]:
        own = [_quads(getattr(part, name)) for part in parts]
        return np.concatenate([*own, *(getattr(image, name) for image in images)])

    return SparseLayout(
        coefficients=_in_rows(coefficients, across),
        lists=_in_rows(np.concatenate([*heads, *lists], 1), across),
        texels=np.concatenate([_quads(_all_levels(own, levels)) for own in texels])[:, None],
        light=maps("light"),
        view=maps("view"),
        levels=levels,
        patches=patch_levels(up, across),
        images=tuple((len(one.mean.light), len(one.deviation.light)) for one in materials),
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


def _listed(
    table: NDArray[np.float32], kinds: tuple[NDArray[np.float32], ...], first: NDArray[np.intp]
) -> _Listed:
    nonzero = table[..., 0] != 0
    # Zeros last, light rows together: a shader sums up to the end of each.
    order = np.lexsort((table[..., 2], ~nonzero), axis=1)
    table = np.take_along_axis(table, order[..., None], 1).copy()
    nonzero = table[..., 0] != 0
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


def masks_of_levels(masks: NDArray[np.floating], layout: SparseLayout) -> NDArray[np.float32]:
    """Weights (n, y, x) of materials as a texture (rows, patches across, texels of levels, 4), for
    all patches. Raises NacreError for another size."""
    if masks.shape != (len(layout.images), layout.height, layout.width):
        raise NacreError(
            f"masks of {masks.shape[2]} x {masks.shape[1]} texels for {len(masks)} materials: "
            f"expected {layout.width} x {layout.height} for {len(layout.images)}"
        )
    (tall, wide), (up, across) = layout.levels[0], layout.patches[0]
    over = ((0, up * tall - layout.height), (0, across * wide - layout.width))
    whole = np.pad(masks, ((0, BLENDED - len(masks)), *over), mode="edge").astype(np.float32)
    whole[len(masks) :] = 0.0
    patches = whole.reshape(BLENDED, up, tall, across, wide).transpose(0, 1, 3, 2, 4)
    found = _all_levels(patches.reshape(-1, tall, wide), layout.levels)
    fine = np.moveaxis(found.reshape(BLENDED, up * across, -1), 0, -1)
    means = _all_levels(fine[:, -1].T.reshape(BLENDED, up, across), layout.patches).T
    coarse = np.broadcast_to(means[up * across :, None], (len(means) - len(fine), *fine.shape[1:]))
    return _in_rows(np.concatenate([fine, coarse]), across)


def _in_rows(patches: NDArray[np.float32], across: int) -> NDArray[np.float32]:
    """Patches (n, columns, 4) side by side in rows: (rows, across, columns, 4)."""
    filled = np.pad(patches, ((0, -len(patches) % across), (0, 0), (0, 0)))
    return filled.reshape(-1, across, *patches.shape[1:])


def _levels(patch: tuple[int, int]) -> tuple[tuple[int, int], ...]:
    """Sizes of a patch, halved down to one texel."""
    sizes = [patch]
    while sizes[-1] != (1, 1):
        sizes.append((max(1, sizes[-1][0] // 2), max(1, sizes[-1][1] // 2)))
    return tuple(sizes)


def _all_levels(
    rows: NDArray[np.float32], levels: tuple[tuple[int, int], ...]
) -> NDArray[np.float32]:
    """Rows (n, h, w) averaged to all levels: (n, texels of all levels)."""
    found = [rows.reshape(len(rows), -1)]
    for size in levels[1:]:
        for axis, length in enumerate(size, 1):
            rows = halve(rows, axis) if rows.shape[axis] != length else rows
        found.append(rows.reshape(len(rows), -1))
    return np.concatenate(found, 1)


def _quads(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Rows (n, ...) in quads (n / 4, ..., 4), filled up with zeros."""
    filled = np.pad(rows, ((0, -len(rows) % 4), *((0, 0),) * (rows.ndim - 1)))
    return np.moveaxis(filled.reshape(-1, 4, *rows.shape[1:]), 1, -1)


def _rounded(quads: int) -> int:
    return max(1, -(-int(quads) // ROUNDED)) * ROUNDED
