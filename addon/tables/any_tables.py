"""The tables of a model of whatever representation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..models.any_model import Model
from ..models.sparse.model import SparseBtf
from .evaluate import evaluate_patch
from .sparse_evaluate import evaluate_sparse_grid
from .sparse_tables import SparseTables, build_sparse_tables
from .tables import Tables, build_tables

AnyTables = Tables | SparseTables


def build_any_tables(
    model: Model, progress: Callable[[float, str], bool] | None = None
) -> AnyTables:
    """What the evaluators of a model read. Raises Cancelled on request."""
    if isinstance(model, SparseBtf):
        return build_sparse_tables(model, progress=progress)
    return build_tables(model, progress=progress)


def evaluate_pictures(
    tables: AnyTables, light: NDArray[np.floating], view: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Linear values (light, view, Y, X, channel) at texel centres for all pairs of unit directions
    (lights, 3) and (views, 3), clamped at 0."""
    if not isinstance(tables, SparseTables):
        return evaluate_patch(tables, light, view)
    found = np.empty((len(light), len(view), tables.height, tables.width, 3), np.float32)
    for (y, x), block in evaluate_sparse_grid(tables, light, view):
        found[:, :, y, x] = block
    return found
