"""The tables evaluated in numpy, written to be read: what the compiled evaluation is compared with.

Everything is summed as tables/tables.py writes it, with whole arrays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from addon.tables.evaluate import light_rows, taps
from addon.tables.parabolic import texel_of
from addon.tables.tables import Tables

_POINTS = 4096  # evaluated at a time, which bounds the memory


def evaluate_patch(
    tables: Tables, light: NDArray[np.floating], view: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Values (light, view, Y, X, channel) of a BTF at texel centres for unit directions, clamped
    at 0."""
    rows = light_rows(tables, light)
    values = [
        np.tensordot(rows, _contract_view(tables, direction), ((2, 3, 4), (0, 1, 2)))
        for direction in np.asarray(view)
    ]
    return np.maximum(np.moveaxis(np.stack(values, 1), 2, -1), 0.0).astype(np.float32)


def evaluate_occlusion(tables: Tables, view: NDArray[np.floating]) -> NDArray[np.float32]:
    """Masks or signed distances (view, Y, X) of occlusion at texel centres for unit directions."""
    values = [_contract_view(tables, direction).sum((0, 1, 2)) for direction in np.asarray(view)]
    return np.stack(values)


def evaluate_points(
    tables: Tables,
    light: NDArray[np.floating],
    view: NDArray[np.floating],
    uv: NDArray[np.floating],
) -> NDArray[np.float32]:
    """Values (n, channel) of a BTF at n points: unit light and view directions (n, 3) in the
    tangent frame and texture coordinates (n, 2) that repeat with the patch; bilinear in space,
    clamped at 0."""
    parts = [
        _points(tables, light[first : first + _POINTS], view[first : first + _POINTS], part)
        for first in range(0, len(uv), _POINTS)
        for part in [np.asarray(uv)[first : first + _POINTS]]
    ]
    return np.maximum(np.concatenate(parts), 0.0).astype(np.float32)


def _points(
    tables: Tables,
    light: NDArray[np.floating],
    view: NDArray[np.floating],
    uv: NDArray[np.floating],
) -> NDArray[np.float32]:
    view_texel, light_texel = (texel_of(np.asarray(d), tables.size).T for d in (view, light))
    view_clusters = tables.view_index[:, view_texel[1], view_texel[0]]  # (K_v, n)
    light_clusters = tables.light_index[:, light_texel[1], light_texel[0]]
    coefficients = tables.view[:, :, :, view_texel[1], view_texel[0]]
    rows = np.moveaxis(tables.light[..., light_texel[1], light_texel[0], :], 3, -2)
    rows = rows.reshape(*rows.shape[:-2], -1)[..., : tables.core.shape[2]]  # (o, c, K_l, n, R)
    points = np.arange(len(uv))
    corners = taps(np.asarray(uv), tables.core.shape[4:6])
    values = np.zeros((len(uv), tables.channels), np.float32)
    for k_l, clusters_l in enumerate(light_clusters):
        own = clusters_l if len(tables.view) > 1 else 0
        for k_v, clusters_v in enumerate(view_clusters):
            weights = coefficients[:, k_v].transpose(2, 0, 1, 3)[points, own]  # (n, quads, 4)
            reduced = sum(
                weight[:, None]
                * np.einsum(
                    "nrqe,nqe->nr", tables.core[clusters_l, clusters_v, :, :, y, x], weights
                )
                for weight, y, x in corners
            )
            other = clusters_v if len(rows) > 1 else 0
            values += np.einsum(
                "ncr,nr->nc", rows[:, :, k_l].transpose(2, 0, 1, 3)[points, other], reduced
            )
    return values * (np.asarray(light)[:, 2:] > 0.0)


def _contract_view(tables: Tables, direction: NDArray[np.floating]) -> NDArray[np.float32]:
    """The core with its view mode contracted: (C_light, C_view or 1, R_light, Y, X).

    Summed over the view's clusters where one set of light rows serves them all.
    """
    column, row = texel_of(direction, tables.size)
    clusters = tables.view_index[:, row, column]
    coefficients = tables.view[:, :, :, row, column]  # (owners, K_v, quads, 4)
    coefficients = np.broadcast_to(coefficients, (len(tables.core), *coefficients.shape[1:]))
    apart = tables.light is not None and len(tables.light) > 1
    light_clusters, view_clusters, rank, _, height, width, _ = tables.core.shape
    reduced = np.zeros(
        (light_clusters, view_clusters if apart else 1, rank, height, width), np.float32
    )
    for k, cluster in enumerate(clusters):
        reduced[:, cluster if apart else 0] += np.einsum(
            "lrqyxe,lqe->lryx", tables.core[:, cluster], coefficients[:, k], optimize=True
        )
    return reduced
