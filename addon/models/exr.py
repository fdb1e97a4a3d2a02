"""Models as files: multi-part OpenEXR with one part for each array."""

from __future__ import annotations

import os
from typing import Any

from numpy.typing import NDArray

from ..datasets.dataset import KINDS
from ..errors import NacreError
from .clustered_tucker import ClusteredTucker, modes_of
from .exr_arrays import (
    check_destination,
    is_model,
    read_arrays,
    read_description,
    read_picture,
    write_arrays,
)

__all__ = ["check_destination", "is_model", "load_model", "read_picture", "save_model"]


_SPARSE = {
    "sparse": "of sparse codes and not of a tensor",
    "sparse-ensemble": "for `compress --method sparse --ensemble`",
}


def save_model(model: ClusteredTucker, path: str | os.PathLike[str]) -> None:
    """Write a model to `path`, through a temporary name; NacreError when it cannot be written."""
    axes = {"core": ["cluster", *model.modes]}
    arrays: dict[str, NDArray[Any]] = {"core": model.core}
    for mode in model.modes:
        arrays[f"basis_{mode}"] = model.bases[mode]
        axes[f"basis_{mode}"] = ["owner", mode, "mixture", "rank"]
    for mode, members in model.members.items():
        arrays[f"members_{mode}"] = members
        axes[f"members_{mode}"] = [mode, "mixture"]
    description = {
        "kind": model.kind,
        "model": "clustered-tucker",
        "modes": list(model.modes),
        "clusters": dict(model.clusters),
        "dataset": dict(model.dataset),
        "fit": dict(model.fit),
    }
    write_arrays(path, arrays, axes, description)


def load_model(path: str | os.PathLike[str]) -> ClusteredTucker:
    """Read a model; NacreError when the file is missing, damaged or not a model of Nacre's."""
    other = read_description(path).get("model")
    if other in _SPARSE:
        raise NacreError(f"{path}: holds a {other!r} model, which is {_SPARSE[other]}")
    arrays, description = read_arrays(path)
    kind = description.get("kind", "btf")
    if description.get("model") != "clustered-tucker" or kind not in KINDS:
        raise NacreError(
            f"{path}: holds a {description.get('model')!r} model of {kind!r}, which is not known "
            "here"
        )
    try:
        return ClusteredTucker(
            core=arrays["core"],
            bases={mode: arrays[f"basis_{mode}"] for mode in modes_of(kind)},
            members={mode: arrays[f"members_{mode}"] for mode in description["clusters"]},
            clusters=description["clusters"],
            dataset=description["dataset"],
            fit=description["fit"],
            kind=kind,
        )
    except KeyError as error:
        raise NacreError(f"{path}: the model has no {error}; compress the dataset again") from error
