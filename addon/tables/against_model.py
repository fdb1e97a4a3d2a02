"""How far the tables are from the model that they were made of."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .any_tables import AnyTables
from .evaluate import evaluate_patch
from .sparse_evaluate import evaluate_sparse_grid
from .sparse_tables import SparseTables

if TYPE_CHECKING:
    from ..models.any_model import Model

_Values = NDArray[np.float32]


def tables_against_model(model: Model, tables: AnyTables) -> dict[str, float]:
    """Errors of the tables at every measured light and view, clamped at 0 on both sides."""
    difference = total = largest = 0.0
    for found, expected in _beside(model, tables):
        error = np.abs(found - np.maximum(expected, 0.0))
        difference += float(error.sum(dtype=float))
        total += float(np.maximum(expected, 0.0).sum(dtype=float))
        largest = max(largest, float(error.max()))
    count = int(np.prod(model.shape))
    return {
        "mean_abs": difference / count,
        "relative": difference / max(total, 1e-12),
        "max_abs": largest,
    }


def _beside(model: Model, tables: AnyTables) -> Iterator[tuple[_Values, _Values]]:
    """Blocks of what tables give, and of what the model does."""
    lights, views = (np.asarray(model.dataset[mode]) for mode in ("light", "view"))
    if isinstance(tables, SparseTables):
        for (y, x), found in evaluate_sparse_grid(tables, lights, views):
            yield found, model.decode(y=y, x=x)
        return
    for number, view in enumerate(views):
        yield evaluate_patch(tables, lights, view[None]), model.decode(view=[number])
