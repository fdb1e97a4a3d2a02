"""The tables of a model of whatever representation."""

from __future__ import annotations

from collections.abc import Callable

from ..models.any_model import Model
from ..models.sparse.model import SparseBtf
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
