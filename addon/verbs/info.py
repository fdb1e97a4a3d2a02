"""Say what a dataset, model or measured file is."""

from __future__ import annotations

import argparse
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .arguments import Progress

if TYPE_CHECKING:
    from ..datasets.dataset import Dataset
    from ..models.clustered_tucker import ClusteredTucker
    from ..models.sparse.ensemble import Ensemble
    from ..models.sparse.model import SparseBtf


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("path", type=Path)


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..datasets.dataset import DESCRIPTION, open_dataset
    from ..datasets.importing import describe_source

    if (options.path / DESCRIPTION).is_file():
        return describe_dataset(open_dataset(options.path))
    if options.path.suffix.lower() == ".exr":
        return _describe_file(options.path)
    return {"what": "measured file", **describe_source(options.path)}


def describe_dataset(dataset: Dataset) -> dict[str, Any]:
    """A dataset for printing; sizes in bytes, the patch in metres."""
    sizes = dataset.sizes
    return {
        "what": "dataset",
        "kind": dataset.kind,
        **{axis: sizes[axis] for axis in ("light", "view") if axis in sizes},
        "width": sizes["x"],
        "height": sizes["y"],
        **({"value": dataset.value} if dataset.value else {"channels": list(dataset.channels)}),
        "dtype": dataset.samples.dtype.name,
        "patch_size": list(dataset.patch_size),
        "raw_bytes": dataset.raw_bytes,
        **({"noise_floor_db": dataset.noise_floor_db} if dataset.noise_floor_db else {}),
        **({"side_channels": list(dataset.side_channels)} if dataset.side_channels else {}),
        "source": _short(dataset.source),
    }


def _describe_file(path: Path) -> dict[str, Any]:
    from ..models.any_model import load_any
    from ..models.exr_arrays import read_description
    from ..models.sparse.files import ENSEMBLE, load_ensemble
    from ..models.sparse.model import SparseBtf

    if read_description(path).get("model") == ENSEMBLE:
        return describe_ensemble(load_ensemble(path), path)
    model = load_any(path)
    if isinstance(model, SparseBtf):
        return describe_sparse(model, path)
    return describe_model(model, path)


def describe_ensemble(ensemble: Ensemble, path: Path) -> dict[str, Any]:
    """An ensemble of dictionaries and its file for printing."""
    training = {key: value for key, value in ensemble.training.items() if key != "objective"}
    return {
        "what": "ensemble",
        "light": len(ensemble.light),
        "view": len(ensemble.view),
        "parts": list(ensemble.dictionaries),
        **training,
        "patch": list(ensemble.patch),
        "dictionaries": {key: len(modes[0]) for key, modes in ensemble.dictionaries.items()},
        "bytes": path.stat().st_size,
    }


def describe_sparse(model: SparseBtf, path: Path) -> dict[str, Any]:
    """A sparse model and its file for printing; code_bytes leave out dictionaries and means."""
    size = path.stat().st_size
    note = f"cut short: loads as quality {model.quality}, of which snr_db is not measured"
    fit = {key: value for key, value in model.fit.items() if model.complete or key != "snr_db"}
    return {
        "what": "model",
        "kind": model.kind,
        **fit,
        "shape": list(model.shape),
        "patch": list(model.ensemble.patch),
        "dictionaries": {key: len(modes[0]) for key, modes in model.ensemble.dictionaries.items()},
        "sparsity": model.sparsity,
        "quality": model.quality,
        **({} if model.complete else {"note": note}),
        "code_bytes": model.code_bytes,
        "bytes": size,
        "ratio": round(4 * prod(model.shape) / size, 2),
        "source": _short(model.dataset["source"]),
    }


def describe_model(model: ClusteredTucker, path: Path) -> dict[str, Any]:
    """A model and its file for printing; `ratio` is the raw float32 size over the file's."""
    size = path.stat().st_size
    return {
        "what": "model",
        "kind": model.kind,
        **({"value": model.dataset["value"]} if "value" in model.dataset else {}),
        **{key: value for key, value in model.fit.items() if key != "errors"},
        **({"domain": model.domain} if model.kind == "btf" else {}),
        "shape": list(model.shape),
        "ranks": model.ranks,
        "clusters": dict(model.clusters),
        "mixtures": model.mixtures,
        "bytes": size,
        "ratio": round(4 * prod(model.shape) / size, 2),
        "source": model.dataset["source"],
    }


def _short(source: dict[str, Any]) -> dict[str, Any]:
    """Where a dataset comes from, without the long list of each picture's noise."""
    if "materials" in source:  # of a blend
        source = source | {"materials": [_short(own) for own in source["materials"]]}
    measurement = source.get("measurement")
    if not isinstance(measurement, dict):
        return source
    kept = {key: value for key, value in measurement.items() if key != "noise"}
    return source | {"measurement": kept}
