"""Sparse tables evaluated on the CPU: what every other evaluator of them is compared with."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..models.sparse.transform import to_linear_rgb
from .parabolic import place_of
from .sparse_tables import Part, Product, SparseTables

_CHUNK = 1024  # points evaluated at a time, each with all of its coefficients

_Taps = list[tuple[NDArray[np.float32], NDArray[np.intp], NDArray[np.intp]]]


def evaluate_sparse_points(
    tables: SparseTables,
    light: NDArray[np.floating],
    view: NDArray[np.floating],
    uv: NDArray[np.floating],
) -> NDArray[np.float32]:
    """Linear colours (n, 3) at n points, clamped at 0: unit light and view directions (n, 3) in the
    tangent frame, texture coordinates (n, 2) that repeat with the patch; of the nearest texel."""
    found = np.empty((len(uv), 3), np.float32)
    for first in range(0, len(uv), _CHUNK):
        part = slice(first, first + _CHUNK)
        found[part] = _points(tables, light[part], view[part], uv[part])
    return found


def _points(
    tables: SparseTables,
    light: NDArray[np.floating],
    view: NDArray[np.floating],
    uv: NDArray[np.floating],
) -> NDArray[np.float32]:
    by_light, by_view = (_taps(own, tables.size) for own in (light, view))
    size = np.array([tables.width, tables.height])
    x, y = np.minimum((np.mod(uv, 1.0) * size).astype(np.intp), size - 1).T
    channels = [_part(part, by_light, by_view, y, x) for part in tables.parts.values()]
    values = np.stack(channels, -1)
    values *= _product(tables.deviation, by_light, by_view)[:, None]
    values += _product(tables.mean, by_light, by_view)[:, None]
    fade = np.clip(light[:, 2] / max(tables.lowest, 1e-6), 0.0, 1.0)
    colours = np.maximum(to_linear_rgb(values, tables.offset), 0.0)
    return np.asarray(colours * fade[:, None], np.float32)


def _part(
    part: Part, by_light: _Taps, by_view: _Taps, y: NDArray[np.intp], x: NDArray[np.intp]
) -> NDArray[np.float32]:
    tall, wide = part.texels.shape[1:]
    coefficients = part.coefficients[:, y // tall, x // wide]
    value, (texel, light, view) = coefficients[..., 0], coefficients[..., 1:].astype(np.intp).T
    product = value * part.texels[texel.T, y % tall, x % wide]
    product *= sum(w * part.light[light.T, row, column] for w, row, column in by_light)
    product *= sum(w * part.view[view.T, row, column] for w, row, column in by_view)
    return np.asarray(product.sum(0), np.float32)


def evaluate_sparse_patch(
    tables: SparseTables, light: NDArray[np.floating], view: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Linear colours (pairs, Y, X, 3) at texel centres for pairs of unit directions (pairs, 3)."""
    rows, columns = np.indices((tables.height, tables.width)).reshape(2, -1)
    uv = np.column_stack([(columns + 0.5) / tables.width, (rows + 0.5) / tables.height])

    def pictures() -> Iterator[NDArray[np.float32]]:
        for one_light, one_view in zip(light, view, strict=True):
            lights, views = (np.broadcast_to(own, (len(uv), 3)) for own in (one_light, one_view))
            yield evaluate_sparse_points(tables, lights, views, uv)

    return np.array(list(pictures())).reshape(-1, tables.height, tables.width, 3)


def evaluate_sparse_grid(
    tables: SparseTables, light: NDArray[np.floating], view: NDArray[np.floating]
) -> Iterator[tuple[tuple[slice, slice], NDArray[np.float32]]]:
    """Rows y and columns x of each patch, and linear colours (light, view, y, x, 3) at its texels
    for all pairs of unit directions: rows of a direction are read once for all patches."""
    by_light, by_view = (_taps(own, tables.size) for own in (light, view))
    tall, wide = tables.patch
    mean, deviation = (
        np.einsum("lqe,vqe->lv", _mixed(own.light, by_light), _mixed(own.view, by_view))
        for own in (tables.mean, tables.deviation)
    )
    parts = list(tables.parts.values())
    rows = [
        (
            part.texels.reshape(len(part.texels), -1),
            _mixed(part.light, by_light),
            _mixed(part.view, by_view),
        )
        for part in parts
    ]
    fade = np.clip(light[:, 2] / max(tables.lowest, 1e-6), 0.0, 1.0)[:, None, None, None, None]
    for up, across in np.ndindex(parts[0].coefficients.shape[1:3]):
        channels = []
        for part, (texels, lights, views) in zip(parts, rows, strict=True):
            value, *numbers = part.coefficients[:, up, across].T
            texel, of_light, of_view = (own.astype(np.intp) for own in numbers)
            left = (value[:, None] * texels[texel])[:, None] * lights.T[of_light][:, :, None]
            whole = left.reshape(len(value), -1).T @ views.T[of_view]
            channels.append(whole.reshape(len(light), tall * wide, len(view)))
        values = np.stack(channels, -1).transpose(0, 2, 1, 3)
        values = values * deviation[:, :, None, None] + mean[:, :, None, None]
        colours = np.maximum(to_linear_rgb(values.astype(np.float32), tables.offset), 0.0)
        colours = colours.reshape(len(light), len(view), tall, wide, 3) * fade
        y, x = slice(up * tall, (up + 1) * tall), slice(across * wide, (across + 1) * wide)
        y, x = slice(y.start, min(y.stop, tables.height)), slice(x.start, min(x.stop, tables.width))
        block = colours[:, :, : y.stop - y.start, : x.stop - x.start]
        yield (y, x), np.asarray(block, np.float32)


def _mixed(maps: NDArray[np.float32], taps: _Taps) -> NDArray[np.float32]:
    """Maps (rows, N, N) at directions: (n, rows); quads (quads, N, N, 4): (n, quads, 4)."""
    shape = (-1, *(1,) * (maps.ndim - 2))
    found = sum(
        w.reshape(shape) * np.moveaxis(maps[:, row, column], 1, 0) for w, row, column in taps
    )
    return np.asarray(found, np.float32)


def _product(product: Product, by_light: _Taps, by_view: _Taps) -> NDArray[np.float32]:
    light, view = _mixed(product.light, by_light), _mixed(product.view, by_view)
    return np.asarray(np.einsum("nqe,nqe->n", light, view), np.float32)


def _taps(directions: NDArray[np.floating], size: int) -> _Taps:
    """The four texels of a map round unit directions (n, 3): weight, row, column."""
    place = place_of(np.asarray(directions, np.float64), size)
    corner = np.clip(np.floor(place).astype(np.intp), 0, size - 2)
    along = (place - corner).astype(np.float32)
    return [
        (
            np.abs(1 - dx - along[:, 0]) * np.abs(1 - dy - along[:, 1]),
            corner[:, 1] + dy,
            corner[:, 0] + dx,
        )
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1))
    ]
