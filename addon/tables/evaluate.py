"""The tables evaluated on the CPU: what every other evaluator is compared with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .parabolic import texel_of
from .tables import Tables


def evaluate_patch(
    tables: Tables, light: NDArray[np.floating], view: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Values (light, view, Y, X, channel) at texel centres for unit directions, clamped at 0."""
    lights = _light_rows(tables, light)
    values = [
        np.einsum("lcr,ryx->lyxc", lights, _contract_view(tables, direction), optimize=True)
        for direction in np.asarray(view)
    ]
    return np.maximum(np.stack(values, 1), 0.0).astype(np.float32)


def evaluate_points(
    tables: Tables,
    light: NDArray[np.floating],
    view: NDArray[np.floating],
    uv: NDArray[np.floating],
) -> NDArray[np.float32]:
    """Values (n, channel) at n points: unit light and view directions (n, 3) in the tangent frame
    and texture coordinates (n, 2) that repeat with the patch; bilinear in space, clamped at 0."""
    column, row = texel_of(np.asarray(view), tables.size).T
    index = tables.index[:, row, column]
    coefficients = tables.view[:, :, row, column]
    size_y, size_x = tables.core.shape[3:5]
    place = np.asarray(uv) * (size_x, size_y) - 0.5
    corner = np.floor(place).astype(np.intp)
    along = place - corner
    reduced = np.zeros((len(place), tables.core.shape[1]), np.float32)
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        weight = np.abs(1 - dx - along[:, 0]) * np.abs(1 - dy - along[:, 1])
        x, y = (corner[:, 0] + dx) % size_x, (corner[:, 1] + dy) % size_y
        texels = tables.core[index, :, :, y, x]  # (mixtures, n, R_light, quads, 4)
        reduced += weight[:, None] * np.einsum("knrqe,kqne->nr", texels, coefficients)
    values = np.einsum("ncr,nr->nc", _light_rows(tables, light), reduced)
    return np.maximum(values, 0.0).astype(np.float32)


def _light_rows(tables: Tables, light: NDArray[np.floating]) -> NDArray[np.float32]:
    """Light basis rows (n, channel, R_light); zero for lights below the horizon."""
    light = np.asarray(light)
    column, row = texel_of(light, tables.size).T
    rows = np.moveaxis(tables.light[:, :, row, column], 2, 0)
    rows = rows.reshape(*rows.shape[:2], -1)[..., : tables.core.shape[1]]
    return rows * (light[:, 2] > 0.0)[:, None, None]


def _contract_view(tables: Tables, direction: NDArray[np.floating]) -> NDArray[np.float32]:
    """The core with its view mode contracted: (R_light, Y, X)."""
    column, row = texel_of(direction, tables.size)
    return np.einsum(
        "krqyxe,kqe->ryx",
        tables.core[tables.index[:, row, column]],
        tables.view[:, :, row, column],
        optimize=True,
    )
