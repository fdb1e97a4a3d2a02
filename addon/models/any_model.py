"""A model file of whatever representation."""

from __future__ import annotations

import os

from ..errors import NacreError
from .clustered_tucker import ClusteredTucker
from .exr import load_model
from .exr_arrays import read_description
from .sparse.files import MODEL, load_progressively, load_sparse
from .sparse.model import SparseBtf

Model = ClusteredTucker | SparseBtf


def load_any(path: str | os.PathLike[str]) -> Model:
    """Read a model; NacreError when the file is missing, damaged or not a model of Nacre's."""
    if read_description(path).get("model") == MODEL:
        return load_sparse(path)
    return load_model(path)


def load_shown(path: str | os.PathLike[str]) -> Model:
    """Read a model to be shown by itself; NacreError also when it is one of occlusion."""
    model = load_any(path)
    if model.kind != "btf":
        raise NacreError(
            f"{path}: a model of {model.kind} has no colours; give it to a BTF's material as its "
            "Occlusion"
        )
    return model


def load_first(path: str | os.PathLike[str]) -> Model:
    """What can be shown first of a BTF: of sparse codes, a low quality out of the first part of the
    file. NacreError as for `load_any`, and for occlusion."""
    if read_description(path).get("model") == MODEL:
        return next(load_progressively(path))
    return load_shown(path)


def quality_of_model(model: Model) -> int:
    """Latent-equivalents of sparse codes; 0 for a model that has no such thing."""
    return model.quality if isinstance(model, SparseBtf) else 0
