"""Compression of measured appearance: N-SVD, CTA, K-CTA, MK-CTA and sparse dictionaries.

A thin skin over a C++ library. Arrays in and out are numpy's; see `__init__.pyi` for signatures.
"""

from ._native import (
    Cancelled,
    Evaluator,
    TableEvaluator,
    __version__,
    code_patches,
    core_gram,
    fit_clustered,
    fit_ensemble,
    fit_nsvd,
    search_clusters,
)

__all__ = [
    "Cancelled",
    "Evaluator",
    "TableEvaluator",
    "__version__",
    "code_patches",
    "core_gram",
    "fit_clustered",
    "fit_ensemble",
    "fit_nsvd",
    "search_clusters",
]
