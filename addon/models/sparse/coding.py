"""Sparse codes of a dataset in a trained ensemble (SparseBTF, Section 3.3)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import nacre_native
import numpy as np
from numpy.typing import NDArray

from ...datasets.dataset import Dataset
from ...datasets.quality import compare_blocks
from ...errors import Cancelled, NacreError
from ..fit import describe
from .ensemble import Ensemble
from .model import Codes, SparseBtf, quality_of
from .patches import channels_of, read_patches, tiling
from .transform import normalisation

_MOST_DB = 120.0  # stands for no error at all


def code(
    dataset: Dataset,
    ensemble: Ensemble,
    sparsity: Mapping[str, int],
    *,
    error: float = 0.0,
    threads: int = 0,
    progress: Callable[[float, str], bool] | None = None,
) -> SparseBtf:
    """Code a dataset.

    sparsity  the most coefficients of each patch, for each part of the ensemble
    error     the mean squared error of normalised values at which a patch has enough of them

    Raises NacreError when the ensemble is not for the dataset, Cancelled on request.
    """
    started = time.monotonic()
    reason = ensemble.misfit(dataset)
    if reason:
        raise NacreError(f"{dataset.path.name}: the ensemble is not for it: {reason}")
    for key, count in sparsity.items():
        most = int(np.prod(ensemble.shape(key)))
        if not 1 <= count <= most:
            raise NacreError(f"sparsity {key}={count}: expected 1 to {most}")
    normalised = normalisation(dataset, ensemble.offset, progress)
    height, width = dataset.sizes["y"], dataset.sizes["x"]
    origins = tiling(height, width, ensemble.patch)
    codes = {
        key: Codes(
            np.zeros((count, len(origins)), np.uint32),
            np.zeros((count, len(origins)), np.float32),
            np.zeros(len(origins), np.uint32),
        )
        for key, count in sparsity.items()
    }

    def report(done: int) -> Callable[[float, str], bool]:
        return lambda fraction, message: (
            progress is None or progress(0.8 * done / len(origins), "Coding patches")
        )

    def last(fraction: float, message: str) -> bool:
        return progress is None or progress(0.8 + 0.2 * fraction, message)

    try:
        for part, patches in read_patches(dataset, normalised, ensemble.patch, origins):
            for key, own in codes.items():
                found = nacre_native.code_patches(
                    channels_of(patches, key),
                    ensemble.dictionaries[key],
                    sparsity[key],
                    error=error,
                    threads=threads,
                    progress=report(part.start),
                )
                own.positions[:, part] = found["positions"].T
                own.values[:, part] = found["values"].T
                own.members[part] = found["members"]
    except nacre_native.Cancelled as stop:
        raise Cancelled from stop
    except (ValueError, MemoryError) as problem:
        raise NacreError(f"{dataset.path.name}: {problem}") from problem
    model = SparseBtf(
        height=height,
        width=width,
        ensemble=ensemble,
        normalised=normalised,
        codes=codes,
        dataset=describe(dataset),
        quality=quality_of(sparsity, ensemble.patch),
    )
    snr_db = round(measure(dataset, model, last)["snr_db"], 4)
    seconds = round(time.monotonic() - started, 3)
    return replace(model, fit={"method": "sparse", "snr_db": snr_db, "seconds": seconds})


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
