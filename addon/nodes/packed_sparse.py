"""A sparse model's tables as images (packed_tables).

A shader loops over the coefficients of a patch and reads four texels for each:

    coefficients  one row for each patch: value, and where its rows are in the other three images
    texels        one row for each row of texels: the products of its y and x columns
    light, view   a tile for each row: in each texel the four values to mix around a direction

Mean and deviation are two more parts after Y, U and V, whose coefficients are 1 and the same in all
patches, and whose row of texels is 1: one loop does it all.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..datasets.directions import spherical_to_unit
from ..models.sparse.transform import to_log_yuv
from ..tables.any_tables import evaluate_pictures
from ..tables.sparse_tables import Part, Product, SparseTables
from .atlas import Atlas, cut_out, make_atlas

Maps = NDArray[np.float32]
ATLASES = ("coefficients", "texels", "light", "view")


@dataclass(frozen=True)
class SparseShapes:
    """Sizes of the arrays of SparseTables; counts and rows in the order Y, U, V, and for light and
    view then of mean and deviation."""

    parts: tuple[str, ...]
    counts: tuple[int, ...]
    texels: tuple[int, ...]
    light: tuple[int, ...]
    view: tuple[int, ...]
    patch: tuple[int, int]
    patches: tuple[int, int]  # up, across
    height: int
    width: int
    size: int
    lowest: float
    offset: float
    average: tuple[float, ...]  # Y, U, V of the logarithm of the mean colour, lit from 45 degrees
    stamp: str  # tells these tables from others

    @property
    def ends(self) -> list[int]:
        """Where the coefficients of Y, U, V, mean and deviation end."""
        return list(accumulate((*self.counts, *self.light[len(self.counts) :])))


@dataclass(frozen=True)
class PackedSparse:
    """Four images, however many lights there are."""

    shapes: SparseShapes
    coefficients: Atlas
    texels: Atlas
    light: Atlas
    view: Atlas

    @property
    def atlases(self) -> dict[str, Atlas]:
        """By part."""
        return {part: getattr(self, part) for part in ATLASES}

    @classmethod
    def restored(cls, shapes: Mapping[str, Any], atlases: Mapping[str, Atlas]) -> PackedSparse:
        """What `atlases` and the fields of `shapes` were taken from."""
        plain = {key: tuple(own) if isinstance(own, list) else own for key, own in shapes.items()}
        return cls(SparseShapes(**plain), **atlases)


def pack_sparse(name: str, tables: SparseTables) -> PackedSparse:
    """Make the images of a model. Raises NacreError when its tables do not fit a texture."""
    shapes = _shapes(tables)
    parts = list(tables.parts.values())
    ones = np.ones((1, *shapes.patch), np.float32)
    texels = np.concatenate([*(part.texels for part in parts), ones])
    blocks = {
        "texels": _texels(texels.reshape(len(texels), -1)),
        "light": _corners([*(p.light for p in parts), *map(_rows, _lights(tables))]),
        "view": _corners([*(p.view for p in parts), *map(_rows, _views(tables))]),
    }
    atlases: dict[str, Atlas] = {}
    try:
        for part, array in blocks.items():
            atlases[part] = make_atlas(f"{name} {part.title()}", array)
        coefficients = _coefficients(tables, shapes, atlases)[None, None, None]
        atlases["coefficients"] = make_atlas(f"{name} Coefficients", coefficients)
    except Exception:
        for atlas in atlases.values():
            bpy.data.images.remove(atlas.image)
        raise
    return PackedSparse(shapes, **atlases)


def unpack_sparse(packed: PackedSparse) -> SparseTables:
    """The tables that were packed."""
    shapes = packed.shapes
    size, count = shapes.size, len(shapes.parts)
    up, across = shapes.patches
    total, patches = shapes.ends[-1], up * across
    coefficients = cut_out(packed.coefficients, 1, patches, total)[0, 0, 0]
    coefficients[..., 1] = coefficients[..., 1] * packed.texels.image.size[1] - 0.5
    for column, atlas in ((2, packed.light), (3, packed.view)):
        coefficients[..., column] *= atlas.columns
    coefficients[..., 1:] = np.rint(coefficients[..., 1:])
    across_texels, rows = packed.texels.image.size
    texels = cut_out(packed.texels, 1, rows, across_texels)[0, 0, 0, ..., 0]
    texels = texels.reshape(rows, *shapes.patch)
    maps = {
        name: np.split(
            cut_out(getattr(packed, name), sum(sizes), size, size)[0, 0, ..., 0],
            list(accumulate(sizes))[:-1],
        )
        for name, sizes in (("light", shapes.light), ("view", shapes.view))
    }
    parts = {}
    begin = 0
    first = np.zeros(3, np.float32)
    for number, key in enumerate(shapes.parts):
        own = coefficients[:, begin : begin + shapes.counts[number]].copy()
        own[..., 1:] -= first
        begin += shapes.counts[number]
        parts[key] = Part(
            coefficients=np.ascontiguousarray(own.reshape(up, across, -1, 4).transpose(2, 0, 1, 3)),
            texels=texels[int(first[0]) :][: shapes.texels[number]],
            light=maps["light"][number],
            view=maps["view"][number],
        )
        first += [own[number] for own in (shapes.texels, shapes.light, shapes.view)]
    images = [
        Product(_quads(maps["light"][i]), _quads(maps["view"][i])) for i in (count, count + 1)
    ]
    return SparseTables(
        parts=parts,
        mean=images[0],
        deviation=images[1],
        lowest=shapes.lowest,
        offset=shapes.offset,
        height=shapes.height,
        width=shapes.width,
    )


def _shapes(tables: SparseTables) -> SparseShapes:
    parts = tables.parts.values()
    some = next(iter(parts))
    return SparseShapes(
        parts=tuple(tables.parts),
        counts=tuple(len(part.coefficients) for part in parts),
        texels=tuple(len(part.texels) for part in parts),
        light=(*(len(part.light) for part in parts), *(4 * len(m) for m in _lights(tables))),
        view=(*(len(part.view) for part in parts), *(4 * len(m) for m in _views(tables))),
        patch=tables.patch,
        patches=(some.coefficients.shape[1], some.coefficients.shape[2]),
        height=tables.height,
        width=tables.width,
        size=tables.size,
        lowest=tables.lowest,
        offset=tables.offset,
        average=_average(tables),
        stamp=_stamp(tables),
    )


def _average(tables: SparseTables) -> tuple[float, ...]:
    light, view = spherical_to_unit([45.0], [45.0]), spherical_to_unit([0.0], [0.0])
    mean = evaluate_pictures(tables, light, view).mean((0, 1, 2, 3))
    return tuple(map(float, to_log_yuv(mean, tables.offset)))


def _stamp(tables: SparseTables) -> str:
    found = hashlib.md5(usedforsecurity=False)
    images = (*tables.parts.values(), tables.mean, tables.deviation)
    for array in (array for own in images for array in vars(own).values()):
        found.update(str(array.shape).encode())
        found.update(np.ascontiguousarray(array))
    return found.hexdigest()


def _coefficients(
    tables: SparseTables, shapes: SparseShapes, atlases: Mapping[str, Atlas]
) -> NDArray[np.float32]:
    """(patches, coefficients, 4) of all parts: value, the texture coordinate up of the row of
    texels, and for light and view the row of tiles plus the part of the width of its column."""
    patches = shapes.patches[0] * shapes.patches[1]
    found = []
    first = np.zeros(3)
    for number, part in enumerate(tables.parts.values()):
        own = part.coefficients.astype(np.float64).reshape(len(part.coefficients), patches, 4)
        own[..., 1:] += first
        found.append(own)
        first += [own[number] for own in (shapes.texels, shapes.light, shapes.view)]
    ones = atlases["texels"].image.size[1] - 1
    for number in range(len(shapes.parts), len(shapes.light)):
        count = shapes.light[number]
        own = np.empty((count, patches, 4))
        own[..., 0], own[..., 1] = 1.0, ones
        own[..., 2] = (first[1] + np.arange(count))[:, None]
        own[..., 3] = (first[2] + np.arange(count))[:, None]
        found.append(own)
        first[1:] += count
    whole = np.concatenate(found).transpose(1, 0, 2)
    whole[..., 1] = (whole[..., 1] + 0.5) / (ones + 1)
    for column, part in ((2, "light"), (3, "view")):
        whole[..., column] /= atlases[part].columns
    return np.ascontiguousarray(whole, np.float32)


def _lights(tables: SparseTables) -> tuple[Maps, Maps]:
    return tables.mean.light, tables.deviation.light


def _views(tables: SparseTables) -> tuple[Maps, Maps]:
    return tables.mean.view, tables.deviation.view


def _rows(quads: Maps) -> Maps:
    """(quads, N, N, 4) as (rows, N, N)."""
    return np.moveaxis(quads, -1, 1).reshape(-1, *quads.shape[1:3])


def _quads(rows: Maps) -> Maps:
    return np.ascontiguousarray(np.moveaxis(rows.reshape(-1, 4, *rows.shape[1:]), 1, -1))


def _texels(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """(rows, texels) as the one tile of an atlas; green marks the last row, for readers that do not
    know which end of an image is up."""
    tile = np.zeros((*rows.shape, 4), np.float32)
    tile[..., 0], tile[-1, :, 1] = rows, 1.0
    return tile[None, None, None]


def _corners(maps: Sequence[Maps]) -> NDArray[np.float32]:
    """Tiles in whose texels (y, x) are the four values from there to (y + 1, x + 1)."""
    rows = np.pad(np.concatenate(maps), ((0, 0), (0, 1), (0, 1)), mode="edge")
    corners = rows[:, :-1, :-1], rows[:, :-1, 1:], rows[:, 1:, :-1], rows[:, 1:, 1:]
    return np.stack(corners, -1)[None, None]
