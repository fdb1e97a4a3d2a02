"""A model file of whatever representation."""

from __future__ import annotations

import os

from .clustered_tucker import ClusteredTucker
from .exr import load_model
from .exr_arrays import read_description
from .sparse.files import MODEL, load_sparse
from .sparse.model import SparseBtf

Model = ClusteredTucker | SparseBtf


def load_any(path: str | os.PathLike[str]) -> Model:
    """Read a model; NacreError when the file is missing, damaged or not a model of Nacre's."""
    if read_description(path).get("model") == MODEL:
        return load_sparse(path)
    return load_model(path)
