"""Clustered tensor approximation: N-SVD, CTA, K-CTA and MK-CTA of measured appearance.

A thin skin over a C++ library. Arrays in and out are numpy's; see `__init__.pyi` for signatures.
"""

from ._native import (
    Cancelled,
    Evaluator,
    TableEvaluator,
    __version__,
    core_gram,
    fit_clustered,
    fit_nsvd,
    search_clusters,
)

__all__ = [
    "Cancelled",
    "Evaluator",
    "TableEvaluator",
    "__version__",
    "core_gram",
    "fit_clustered",
    "fit_nsvd",
    "search_clusters",
]
