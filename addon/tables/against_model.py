"""How far the tables are from the model they were made of."""

from __future__ import annotations

import numpy as np

from ..models.clustered_tucker import ClusteredTucker
from .evaluate import evaluate_patch
from .tables import Tables


def tables_against_model(model: ClusteredTucker, tables: Tables) -> dict[str, float]:
    """Errors of the tables at every measured light and view, clamped at 0 on both sides."""
    lights = np.asarray(model.dataset["light"])
    difference = total = largest = 0.0
    for number, view in enumerate(np.asarray(model.dataset["view"])):
        expected = np.maximum(model.decode(view=[number]), 0.0)
        error = np.abs(evaluate_patch(tables, lights, view[None]) - expected)
        difference += float(error.sum(dtype=float))
        total += float(expected.sum(dtype=float))
        largest = max(largest, float(error.max()))
    count = int(np.prod(model.shape))
    return {
        "mean_abs": difference / count,
        "relative": difference / max(total, 1e-12),
        "max_abs": largest,
    }
