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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("path", type=Path)


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..datasets.dataset import DESCRIPTION, open_dataset
    from ..datasets.importing import describe_source

    if (options.path / DESCRIPTION).is_file():
        return describe_dataset(open_dataset(options.path))
    if options.path.suffix.lower() == ".exr":
        from ..models.exr import load_model

        return describe_model(load_model(options.path), options.path)
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
    measurement = source.get("measurement")
    if not isinstance(measurement, dict):
        return source
    kept = {key: value for key, value in measurement.items() if key != "noise"}
    return source | {"measurement": kept}
