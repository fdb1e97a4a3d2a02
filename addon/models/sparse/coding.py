"""Sparse codes of a dataset in a trained ensemble (SparseBTF, Section 3.3)."""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import Any

import nacre_native
import numpy as np
from numpy.typing import NDArray

from ...datasets.dataset import Dataset
from ...datasets.quality import compare_blocks
from ...errors import Cancelled, NacreError
from ..checkpoint import StateFile, samples_of
from ..fit import describe
from .ensemble import Ensemble
from .model import Codes, SparseBtf, quality_of
from .patches import BLOCK, channels_of, read_patches, tiling
from .split import by_quality
from .transform import Normalisation, normalisation

_PROGRAM = 120_000_000  # bytes that Python, numpy and the dictionaries take
_MOST_DB = 120.0  # stands for no error at all


def code(
    dataset: Dataset,
    ensemble: Ensemble,
    sparsity: Mapping[str, int] | int,
    *,
    error: float = 0.0,
    threads: int = 0,
    memory: int = 0,
    state: Path | None = None,
    resume: bool = False,
    progress: Callable[[float, str], bool] | None = None,
) -> SparseBtf:
    """Code a dataset.

    sparsity  the most coefficients of each patch, for each part of the ensemble, or a quality whose
              coefficients are divided among the parts as the dataset needs (split.by_quality)
    error     the mean squared error of normalised values at which a patch has enough of them
    memory    bytes of anonymous memory to take, but at least for one patch and all codes; 0 for a
              usual block of patches
    state     a file that keeps what is coded now and then, removed at the end
    resume    go on from `state`, if it is there: to the same codes, as patches do not depend on
              each other

    Raises NacreError when the ensemble is not for the dataset, Cancelled on request.
    """
    started = time.monotonic()
    reason = ensemble.misfit(dataset)
    if reason:
        raise NacreError(f"{dataset.path.name}: the ensemble is not for it: {reason}")
    if not isinstance(sparsity, int):
        _check(sparsity, ensemble)
    said = {"sparsity": sparsity, "error": error, "ensemble": _fingerprint(ensemble)}
    file = StateFile(state, [said, samples_of(dataset)]) if state else None
    height, width = dataset.sizes["y"], dataset.sizes["x"]
    origins = tiling(height, width, ensemble.patch)
    kept = _restored(file, ensemble.offset) if file and resume else None
    try:
        if kept:
            normalised, codes, done = kept
        else:
            normalised, done = _normalised(dataset, ensemble, progress), 0
            if isinstance(sparsity, int):
                sparsity = by_quality(dataset, ensemble, normalised, sparsity, threads)
            codes = {key: _empty(count, len(origins)) for key, count in sparsity.items()}
        block = _block(memory, dataset, ensemble.patch, codes) if memory else BLOCK
        for part, patches in read_patches(
            dataset, normalised, ensemble.patch, origins[done:], block
        ):
            part = slice(done + part.start, done + part.stop)
            if progress and not progress(0.8 * part.start / len(origins), "Coding patches"):
                raise Cancelled
            for key, own in codes.items():
                found = nacre_native.code_patches(
                    channels_of(patches, key),
                    ensemble.dictionaries[key],
                    len(own.values),
                    error=error,
                    threads=threads,
                    progress=_still(progress, 0.8 * part.start / len(origins)),
                )
                own.positions[:, part] = found["positions"].T
                own.values[:, part] = found["values"].T
                own.members[part] = found["members"]
            if file and file.due:
                file.save(*_state(normalised, codes, part.stop))
    except (nacre_native.Cancelled, Cancelled) as stop:
        if file and not resume:
            file.remove()
        raise Cancelled from stop
    except (ValueError, MemoryError) as problem:
        raise NacreError(f"{dataset.path.name}: {problem}") from problem
    model = SparseBtf(
        height=height,
        width=width,
        ensemble=ensemble,
        normalised=normalised,
        codes={key: own.rounded() for key, own in codes.items()},
        dataset=describe(dataset),
        quality=quality_of({key: len(own.values) for key, own in codes.items()}, ensemble.patch),
    )

    def last(fraction: float, message: str) -> bool:
        return progress is None or progress(0.8 + 0.2 * fraction, message)

    snr_db = round(measure(dataset, model, last)["snr_db"], 4)
    if file:
        file.remove()
    seconds = round(time.monotonic() - started, 3)
    return replace(model, fit={"method": "sparse", "snr_db": snr_db, "seconds": seconds})


def _check(sparsity: Mapping[str, int], ensemble: Ensemble) -> None:
    for key, count in sparsity.items():
        most = int(np.prod(ensemble.shape(key)))
        if not 1 <= count <= most:
            raise NacreError(f"sparsity {key}={count}: expected 1 to {most}")


def _normalised(
    dataset: Dataset, ensemble: Ensemble, progress: Callable[[float, str], bool] | None
) -> Normalisation:
    return normalisation(dataset, ensemble.offset, ensemble.by_deviation, progress)


def _empty(count: int, patches: int) -> Codes:
    return Codes(
        np.zeros((count, patches), np.uint32),
        np.zeros((count, patches), np.float32),
        np.zeros(patches, np.uint32),
    )


def _still(
    progress: Callable[[float, str], bool] | None, fraction: float
) -> Callable[[float, str], bool]:
    """Progress of one block: it stands where the block began."""
    return lambda _, message: progress is None or progress(fraction, message)


def _fingerprint(ensemble: Ensemble) -> int:
    """A number that tells one ensemble's matrices from another's."""
    checksum = 0
    for modes in ensemble.dictionaries.values():
        for matrices in modes:
            checksum = zlib.crc32(np.ascontiguousarray(matrices).tobytes(), checksum)
    return checksum


def _state(
    normalised: Normalisation, codes: Mapping[str, Codes], done: int
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """What is coded so far: of the first `done` patches."""
    arrays: dict[str, NDArray[Any]] = {
        "mean": normalised.mean,
        "deviation": normalised.deviation,
    }
    for key, own in codes.items():
        arrays[f"positions_{key}"] = own.positions[:, :done]
        arrays[f"values_{key}"] = own.values[:, :done]
        arrays[f"members_{key}"] = own.members[:done]
    patches = len(next(iter(codes.values())).members)
    return arrays, {"done": done, "patches": patches, "parts": list(codes)}


def _restored(file: StateFile, offset: float) -> tuple[Normalisation, dict[str, Codes], int] | None:
    """What was kept: the normalisation, codes of all patches, and of how many they are there."""
    found = file.load()
    if found is None:
        return None
    arrays, rest = found
    try:
        done, codes = int(rest["done"]), {}
        for key in rest["parts"]:
            positions, values = arrays[f"positions_{key}"], arrays[f"values_{key}"]
            codes[key] = own = _empty(len(values), int(rest["patches"]))
            own.positions[:, :done] = positions
            own.values[:, :done] = values
            own.members[:done] = arrays[f"members_{key}"]
        return Normalisation(arrays["mean"], arrays["deviation"], offset), codes, done
    except (KeyError, ValueError) as error:
        raise file.damaged() from error


def _block(
    memory: int, dataset: Dataset, patch: tuple[int, int], codes: Mapping[str, Codes]
) -> int:
    """Values of patches that may be in memory at a time."""
    one = 3 * prod(dataset.shape[:2]) * prod(patch)
    # Of all codes the positions and values, and as much again where they are kept or written.
    whole = 2 * sum(own.positions.nbytes + own.values.nbytes for own in codes.values())
    # A value takes four bytes, one of three channels four more; what is made of one patch, 24.
    return int((memory - _PROGRAM - whole - 24 * one) / (4 + 4 / 3))


def measure(
    dataset: Dataset,
    model: SparseBtf,
    progress: Callable[[float, str], bool] | None = None,
) -> dict[str, float]:
    """SNR in dB and mean squared error of linear values; decodes patch by patch."""
    return measure_against(lambda y, x: dataset.samples[:, :, y, x], model, progress)


def measure_against(
    read: Callable[[slice, slice], NDArray[np.floating]],
    model: SparseBtf,
    progress: Callable[[float, str], bool] | None = None,
) -> dict[str, float]:
    """`measure`, of samples (light, view, y, x, channel) that are read by some y and x."""
    tall, wide = model.ensemble.patch

    def pairs() -> Iterator[tuple[NDArray[np.floating], NDArray[np.floating]]]:
        for y in range(0, model.height, tall):
            if progress is not None and not progress(y / model.height, "Measuring the error"):
                raise Cancelled
            for x in range(0, model.width, wide):
                part = (slice(y, y + tall), slice(x, x + wide))
                yield read(*part), model.decode(y=part[0], x=part[1])

    found = compare_blocks(pairs())
    snr, mse = found["snr_db"], found["mse"]
    assert mse is not None
    return {"snr_db": _MOST_DB if snr is None else min(snr, _MOST_DB), "mse": mse}
