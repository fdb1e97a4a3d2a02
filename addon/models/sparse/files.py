"""Ensembles and sparse models as OpenEXR files.

The coefficients of a model are in levels of quality, the most important ones first: what is found
of a file that was cut short is a model of lower quality.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from math import prod
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import NacreError
from ..exr_arrays import read_arrays, read_description, read_growing, write_arrays
from .authors import is_authors_folder, load_authors_ensemble
from .ensemble import Ensemble, orthonormal
from .model import Codes, SparseBtf, counts_at
from .packing import pack, unpack
from .transform import Normalisation

ENSEMBLE, MODEL = "sparse-ensemble", "sparse"

QUALITIES = (1, 2, 4, 8, 16, 24, 32, 48, 64, 96, 128, 192, 256)
"""Latent-equivalents at which a file may be cut; the last level is the model's own quality."""

SHIPPED = Path(__file__).parents[2] / "ensembles"
"""Trained on Nacre's own scenes (benchmarks/recipes/ensembles.py), a file a set of directions."""

_MODES = ("y", "x", "light", "view", "colour")


def save_ensemble(ensemble: Ensemble, path: str | os.PathLike[str]) -> None:
    """Write an ensemble; NacreError when it cannot be written."""
    arrays, axes = _dictionary_arrays(ensemble)
    write_arrays(
        path, arrays, axes, {"kind": "btf", "model": ENSEMBLE, **_describe_ensemble(ensemble)}
    )


def load_ensemble(path: str | os.PathLike[str]) -> Ensemble:
    """An ensemble out of our file or of a folder of the authors'; NacreError when it is neither."""
    if is_authors_folder(Path(path)):
        return load_authors_ensemble(Path(path))
    if os.path.isdir(path):
        raise NacreError(f"{path}: a folder without bonn_angles.bin is no ensemble")
    arrays, description = read_arrays(path)
    if description.get("model") not in (ENSEMBLE, MODEL):
        raise NacreError(f"{path}: a model of another method, not an ensemble of dictionaries")
    return _ensemble(arrays, description)


def ensembles_of(paths: Sequence[str | os.PathLike[str]]) -> dict[str, Ensemble]:
    """The ensembles to choose from, by name: those of `paths`, or where none is given, those that
    Nacre comes with. NacreError as for `load_ensemble`."""
    if paths:
        return {os.fspath(path): load_ensemble(path) for path in paths}
    return {f"Nacre's {path.stem}": load_ensemble(path) for path in sorted(SHIPPED.glob("*.exr"))}


def save_sparse(model: SparseBtf, path: str | os.PathLike[str]) -> None:
    """Write a model with the ensemble it needs; NacreError when it cannot be written."""
    arrays, axes = _dictionary_arrays(model.ensemble)
    arrays = {"mean": model.normalised.mean, "deviation": model.normalised.deviation, **arrays}
    axes |= {"mean": ["light", "view", "channel"], "deviation": ["light", "view"]}
    for key, codes in model.codes.items():
        arrays[f"members_{key}"] = codes.members[None]
        axes[f"members_{key}"] = ["part", "patch"]
    qualities = [quality for quality in QUALITIES if quality < model.quality] + [model.quality]
    begin, counts = dict.fromkeys(model.codes, 0), {}
    size = {key: prod(model.ensemble.atoms(key)) for key in model.codes}
    for quality in qualities:
        ends = counts_at(model.sparsity, quality, model.ensemble.patch)
        for key, codes in model.codes.items():
            part = slice(begin[key], ends[key])
            if ends[key] > begin[key]:
                name = f"codes_{key}_{quality}"
                arrays[name] = pack(
                    codes.positions[part], codes.values[part], size[key], codes.largest
                )
                axes[name] = ["patch", "word"]
                counts[name] = ends[key] - begin[key]
        begin = ends
    description = {
        "kind": "btf",
        "model": MODEL,
        **_describe_ensemble(model.ensemble),
        "size": [model.height, model.width],
        "sparsity": model.sparsity,
        "qualities": qualities,
        "counts": counts,
        "largest": {key: codes.largest for key, codes in model.codes.items()},
        "dataset": dict(model.dataset),
        "fit": dict(model.fit),
    }
    write_arrays(path, arrays, axes, description, partial=True)


def load_sparse(path: str | os.PathLike[str], quality: int | None = None) -> SparseBtf:
    """Read a model, or its `quality` (or the next lower one that the file has) of the coefficients.

    A file that was cut short gives the highest quality that is whole. Raises NacreError when not
    even the lowest is, and for what is not a sparse model.
    """
    arrays, description = read_arrays(path, partial=True)
    return _model(path, arrays, description, quality)


def load_progressively(path: str | os.PathLike[str]) -> Iterator[SparseBtf]:
    """A model while it is read: better and better ones, the last being that of `load_sparse`.

    So a file of any length can be shown when an eighth of it has been read. A file that was cut
    short ends with the highest quality that is whole, not `complete`. Raises NacreError as
    `load_sparse` does.
    """
    best = 0
    for arrays, description in read_growing(path):
        try:
            model = _model(path, arrays, description)
        except _NotYetError:
            continue
        if model.quality > best:
            best = model.quality
            yield model
    if not best:
        load_sparse(path)  # says why there is none


class OpenFile:
    """A model's file that is read once, and no further than a quality asks for."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = path
        self._coming = load_progressively(path)
        self._best: SparseBtf | None = None
        self._lock = Lock()  # several threads may wait for the same file

    def up_to(self, quality: int) -> Iterator[SparseBtf]:
        """Better and better models, the last one of `quality`, or of the file's if that is less.

        Raises NacreError as `load_sparse`.
        """
        shown = 0
        while True:
            with self._lock:
                if self._best is None or self._best.quality <= shown:
                    self._best = next(self._coming, self._best)
                best = self._best or load_sparse(self._path)
            if best.quality <= shown:
                return
            shown = best.quality
            yield best.truncated(quality)
            if shown >= quality:
                return


def promised_quality(path: str | os.PathLike[str]) -> int:
    """The quality of a sparse model's file if it is whole, read from its header; 0 for a model of
    another kind. Raises NacreError for what is no model."""
    qualities = read_description(path).get("qualities", [0])
    return int(qualities[-1])


class _NotYetError(NacreError):
    """Not even the lowest quality is there."""


def _model(
    path: str | os.PathLike[str],
    arrays: dict[str, NDArray[Any]],
    description: dict[str, Any],
    quality: int | None = None,
) -> SparseBtf:
    if description.get("model") != MODEL:
        raise NacreError(f"{path}: not a sparse model but {description.get('model')!r}")
    try:
        whole = _levels(arrays, description)
        wanted = [q for q in whole if quality is None or q <= quality]
        if whole and not wanted:
            raise NacreError(f"{path}: its lowest quality is {whole[0]}, not {quality}")
        ensemble = _ensemble(arrays, description)
        codes = {
            key: _codes(arrays, description, key, prod(ensemble.atoms(key)), wanted)
            for key in description["sparsity"]
        }
        return SparseBtf(
            height=description["size"][0],
            width=description["size"][1],
            ensemble=ensemble,
            normalised=Normalisation(arrays["mean"], arrays["deviation"], description["offset"]),
            codes=codes,
            dataset=description["dataset"],
            fit=description["fit"],
            quality=wanted[-1],
            complete=wanted[-1] == description["qualities"][-1],
        )
    except (LookupError, ValueError) as error:
        raise _NotYetError(
            f"{path}: cut short or damaged before its lowest quality; copy it or compress the "
            "dataset again"
        ) from error


def _levels(arrays: dict[str, NDArray[Any]], description: dict[str, Any]) -> list[int]:
    """The qualities whose coefficients, and those of all lower ones, were found."""
    expected = description["arrays"]
    whole = []
    for quality in description["qualities"]:
        names = [
            name for name in expected if name.startswith("codes_") and name.endswith(f"_{quality}")
        ]
        if any(name not in arrays for name in names):
            break
        whole.append(quality)
    return whole


def _codes(
    arrays: dict[str, NDArray[Any]],
    description: dict[str, Any],
    key: str,
    size: int,
    qualities: list[int],
) -> Codes:
    counts, largest = description["counts"], description["largest"][key]
    names = [f"codes_{key}_{quality}" for quality in qualities]
    levels = [unpack(arrays[name], counts[name], size, largest) for name in names if name in arrays]
    positions, values = (np.concatenate(own) for own in zip(*levels, strict=True))
    return Codes(positions, values, arrays[f"members_{key}"][0])


def _describe_ensemble(ensemble: Ensemble) -> dict[str, Any]:
    return {
        "patch": list(ensemble.patch),
        "light": ensemble.light.tolist(),
        "view": ensemble.view.tolist(),
        "parts": list(ensemble.dictionaries),
        "offset": ensemble.offset,
        "by_deviation": ensemble.by_deviation,
        "training": dict(ensemble.training),
    }


def _dictionary_arrays(
    ensemble: Ensemble,
) -> tuple[dict[str, NDArray[Any]], dict[str, list[str]]]:
    arrays: dict[str, NDArray[Any]] = {}
    axes = {}
    for key, modes in ensemble.dictionaries.items():
        for mode, matrices in zip(_MODES, modes, strict=False):
            arrays[f"dictionaries_{key}_{mode}"] = matrices
            axes[f"dictionaries_{key}_{mode}"] = ["dictionary", mode, "atom"]
    return arrays, axes


def _ensemble(arrays: dict[str, NDArray[Any]], description: dict[str, Any]) -> Ensemble:
    dictionaries = {
        key: tuple(
            orthonormal(arrays[f"dictionaries_{key}_{mode}"])
            for mode in _MODES[: 5 if len(key) > 1 else 4]
        )
        for key in description["parts"]
    }
    return Ensemble(
        patch=(description["patch"][0], description["patch"][1]),
        light=np.array(description["light"], np.float64),
        view=np.array(description["view"], np.float64),
        dictionaries=dictionaries,
        offset=description["offset"],
        by_deviation=description["by_deviation"],
        training=description["training"],
    )
