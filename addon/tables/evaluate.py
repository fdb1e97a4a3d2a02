"""The tables evaluated on the CPU: what every other evaluator is compared with."""

from __future__ import annotations

import nacre_native
import numpy as np
from numpy.typing import NDArray

from .parabolic import texel_of
from .tables import Tables


def evaluate_patch(
    tables: Tables, light: NDArray[np.floating], view: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Values (light, view, Y, X, channel) of a BTF at texel centres for unit directions, clamped
    at 0."""
    return _evaluator(tables).patch(light, view)


def evaluate_occlusion(tables: Tables, view: NDArray[np.floating]) -> NDArray[np.float32]:
    """Masks or signed distances (view, Y, X) of occlusion at texel centres for unit directions."""
    return _evaluator(tables).patch(None, view)


def evaluate_points(
    tables: Tables,
    light: NDArray[np.floating],
    view: NDArray[np.floating],
    uv: NDArray[np.floating],
) -> NDArray[np.float32]:
    """Values (n, channel) of a BTF at n points: unit light and view directions (n, 3) in the
    tangent frame and texture coordinates (n, 2) that repeat with the patch; bilinear in space,
    clamped at 0."""
    return _evaluator(tables).points(light, view, uv)


def _evaluator(tables: Tables) -> nacre_native.TableEvaluator:
    return nacre_native.TableEvaluator(
        tables.core, tables.light, tables.view, tables.light_index, tables.view_index
    )


def reduced_points(
    tables: Tables, view: NDArray[np.floating], uv: NDArray[np.floating]
) -> NDArray[np.float32]:
    """The core contracted with the view at n points: (n, C_view or 1, C_light, R_light), summed
    over the view's clusters where one set of light rows serves them all."""
    apart = len(_lights(tables)) > 1
    column, row = texel_of(np.asarray(view), tables.size).T
    points = np.arange(len(uv))
    count, clusters, rank = tables.core.shape[:3]
    reduced = np.zeros((len(uv), clusters if apart else 1, count, rank), np.float32)
    coefficients = tables.view[:, :, :, row, column]  # (owners, K_v, quads, n, 4)
    for k, cluster in enumerate(tables.view_index[:, row, column]):
        for weight, y, x in taps(np.asarray(uv), tables.core.shape[4:6]):
            texels = tables.core[:, cluster, :, :, y, x]  # (n, C_light, R, quads, 4)
            weights = np.broadcast_to(coefficients[:, k], (count, *coefficients.shape[2:]))
            reduced[points, cluster if apart else 0] += weight[:, None, None] * np.einsum(
                "nlrqe,lqne->nlr", texels, weights
            )
    return reduced


def taps(
    uv: NDArray[np.floating], size: tuple[int, ...]
) -> list[tuple[NDArray[np.floating], NDArray[np.intp], NDArray[np.intp]]]:
    """The four texels round points (n, 2): weight, y and x."""
    height, width = size
    place = uv * (width, height) - 0.5
    corner = np.floor(place).astype(np.intp)
    along = place - corner
    return [
        (
            np.abs(1 - dx - along[:, 0]) * np.abs(1 - dy - along[:, 1]),
            (corner[:, 1] + dy) % height,
            (corner[:, 0] + dx) % width,
        )
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1))
    ]


def _lights(tables: Tables) -> NDArray[np.float32]:
    """The light maps; ValueError for tables of occlusion."""
    if tables.light is None:
        raise ValueError("tables: expected those of a BTF, not of occlusion")
    return tables.light


def _flat(rows: NDArray[np.float32], tables: Tables) -> NDArray[np.float32]:
    """Quads (owners, channels, K, quads, n, 4) as ranks (owners, channels, K, n, R_light)."""
    rows = np.moveaxis(rows, 3, -2)
    return rows.reshape(*rows.shape[:-2], -1)[..., : tables.core.shape[2]]


def light_rows(tables: Tables, light: NDArray[np.floating]) -> NDArray[np.float32]:
    """Light basis rows with those of all clusters, zero where a light has none of it: (n, channel,
    C_light, C_view or 1, R_light); zero for lights below the horizon."""
    light = np.asarray(light)
    column, row = texel_of(light, tables.size).T
    rows = _flat(_lights(tables)[..., row, column, :], tables)  # (owners, c, K, n, R)
    clusters = tables.light_index[:, row, column]
    points = np.arange(len(light))
    dense = np.zeros((len(light), rows.shape[1], len(tables.core), len(rows), rows.shape[-1]))
    for k, members in enumerate(clusters):
        dense[points, :, members] += np.moveaxis(rows[:, :, k], 2, 0).transpose(0, 2, 1, 3)
    return (dense * (light[:, 2] > 0.0)[:, None, None, None, None]).astype(np.float32)
