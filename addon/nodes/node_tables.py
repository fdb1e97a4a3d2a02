"""What node groups need of a model, in this version of Blender."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from ..models.any_model import Model
from ..models.sparse.as_tensor import fit_tensor
from ..models.sparse.model import SparseBtf
from ..tables.any_tables import AnyTables, build_any_tables
from ..tables.sparse_tables import build_sparse_tables
from ..tables.tables import build_tables
from .loops import has_zones

_FIT = 0.9  # of the time


def build_node_tables(
    model: Model, progress: Callable[[float, str], bool] | None = None
) -> AnyTables:
    """Tables of a model; of a sparse one with those of a tensor model, a fit of it, where EEVEE
    cannot loop over coefficients (Blender 4.5). Raises NacreError when there is no room for a
    temporary file, Cancelled on request."""
    if has_zones() or not isinstance(model, SparseBtf):
        return build_any_tables(model, progress)

    def part(begin: float, end: float) -> Callable[[float, str], bool] | None:
        if progress is None:
            return None
        return lambda f, text: progress(begin + (end - begin) * f, f"Fitting for EEVEE: {text}")

    fitted = build_tables(fit_tensor(model, part(0.0, _FIT)), progress=part(_FIT, 1.0))
    return replace(build_sparse_tables(model), stand_in=fitted)
