"""Fits whose errors are weighed by how much lighter or darker they look; the models stay linear.

Equal weights spend a model on highlights, which hold most of the energy and are white on every
screen, at the cost of all else. Lightness (CIE L*) goes with the cube root, so an error beside a
value M looks like one of M^(-2/3): its square is weighed by

    w = (knee / B)^(4/3) min(1, B / |A - M|),     B = max(M, knee), knee: the mean of the samples A.

The first factor is of the model's value, not of the sample's: else what is noise to the model, as
much above as below, would make it darker. The second is Huber's, and bounds what a highlight that
the model cannot have pulls. Minimising sum w (A - M)^2 over models M is the weighted low-rank
approximation of Srebro and Jaakkola (ICML 2003), by a fit of unweighted targets in every round:

    T = M + step w (A - M)

where M is the last round's model. Values are light as before: sums over lights, an environment's
light and every evaluator need not know of it.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..datasets.dataset import Dataset
from ..errors import Cancelled, NacreError
from .checkpoint import Checkpoint
from .clustered_tucker import MODES, ClusteredTucker
from .fit import compress, describe
from .snr import measure_snr
from .steps import Progress, Steps

_BRIGHTEST = 6.0
"""Knees at which samples are cut for the first model: from one that has all of the highlights it
takes several times as many rounds."""

_EXACT = 1e-6
"""The error at which nothing is left to be weighed."""

_STEP = 1.6
"""Below 2, as for every gradient descent on a quadratic function of weights up to 1."""

_FRESH = (0, 3)
"""Rounds that begin without a model: by the fourth the targets say what is worth a basis."""

_ROUNDS = 8
_BLOCK = 2**21  # values in memory at a time, of each thread
_THREADS = min(4, os.cpu_count() or 1)  # beyond, memory is the bound
_IMAGES = 1024  # of which the knee is the mean


def compress_by_lightness(
    dataset: Dataset,
    method: str,
    *,
    folder: Path,
    state: Path | None = None,
    resume: bool = False,
    progress: Progress | None = None,
    **settings: Any,
) -> ClusteredTucker:
    """Fit a model of linear values whose errors are weighed by lightness.

    folder  where targets, as large as the samples, are kept during the fit

    The rest is as for `compress`. `fit["errors"]` are the weighed ones of each round's model but
    the last, sum w (A - M)^2 / sum w A^2; `fit["snr_db"]` is unweighed. Raises NacreError for
    occlusion and for settings that do not fit the dataset, Cancelled on request.
    """
    if dataset.kind != "btf":
        raise NacreError(f"{dataset.path.name}: lightness is of colours, not of {dataset.kind}")
    started = time.monotonic()
    rounds = _Rounds(state, dataset, {"method": method, **settings})
    model, errors = rounds.load() if resume else (None, [])
    knee = _knee(dataset)
    steps = Steps(progress)
    try:
        with _targets(dataset, folder) as (targets, file):
            for number in range(len(errors), _ROUNDS):
                step = steps.step(_ROUNDS + 1 - number)
                squared_norm, error = _aim(file, dataset.samples, model, knee, step)
                errors.append(error)
                if model is not None and error < _EXACT:
                    break
                # An N-SVD has no clusters to lose.
                fresh = number in _FRESH or method == "nsvd"
                start = None if model is None or fresh else (model, squared_norm)
                model = compress(
                    targets,
                    method,
                    start=start,
                    iterations=1 if start else None,
                    state=None if start else rounds.within(number),
                    resume=resume,
                    progress=step,
                    **settings,
                )
                rounds.save(model, errors)
        assert model is not None  # a saved state has at most the last round's
        snr_db = measure_snr(dataset, model, steps.step(1))
    except Cancelled:
        if not resume:
            rounds.remove()
        raise
    rounds.remove()
    said = {
        "weights": "lightness",
        "errors": errors[1:],
        "iterations": len(errors),
        "passes": len(errors) + 1,
        "snr_db": round(snr_db, 4),
        "seconds": round(time.monotonic() - started, 3),
    }
    return replace(model, fit={**model.fit, **said})


def _knee(dataset: Dataset) -> float:
    """About the mean of the samples."""
    lights, views = dataset.shape[:2]
    chosen = np.unique(np.linspace(0, lights * views - 1, _IMAGES).astype(int))
    means = [float(dataset.samples[divmod(n, views)].mean(dtype=np.float64)) for n in chosen]
    return max(float(np.mean(means)), 1e-6)


@contextmanager
def _targets(dataset: Dataset, folder: Path) -> Iterator[tuple[Dataset, BinaryIO]]:
    """The dataset with the samples of a file, and that file to write them to.

    They are written, not assigned to the map, which could not say that the disk is full.
    """
    try:
        with (
            tempfile.TemporaryDirectory(dir=folder, prefix=".nacre-") as name,
            (Path(name) / "targets").open("w+b", buffering=0) as file,
        ):
            file.truncate(dataset.samples.nbytes)
            samples = np.memmap(file, dataset.samples.dtype, "r", shape=dataset.shape)
            yield replace(dataset, samples=samples), file
    except OSError as error:
        raise NacreError(f"cannot write to {folder}: {error.strerror}") from error


def _aim(
    file: BinaryIO,
    samples: NDArray[Any],
    model: ClusteredTucker | None,
    knee: float,
    progress: Progress,
) -> tuple[float, float]:
    """Write the targets of a round; their squared norm and the weighed error of the model."""
    largest = np.finfo(samples.dtype).max
    count = max(1, _BLOCK // prod(samples.shape[1:]))

    def block(part: slice) -> tuple[NDArray[Any], NDArray[np.float64]]:
        a = np.asarray(samples[part], np.float32)
        error = energy = 0.0
        if model is None:
            t = np.minimum(a, _BRIGHTEST * knee)
        else:
            m = model.decode(light=part)
            beside = np.maximum(m, knee)
            off = a - m
            w = np.cbrt(knee / beside) ** 4
            w *= np.minimum(1.0, beside / np.maximum(np.abs(off), knee))
            wanted = w * off
            error = float(np.vdot(wanted, off))
            energy = float(np.vdot(w * a, a))
            t = m + _STEP * wanted
        t = np.clip(t, -largest, largest)
        return t.astype(samples.dtype), np.array((np.vdot(t, t), error, energy), np.float64)

    sums = np.zeros(3)
    file.seek(0)
    parts = [slice(first, first + count) for first in range(0, len(samples), count)]
    with ThreadPoolExecutor(_THREADS) as pool:
        for group in range(0, len(parts), _THREADS):
            if not progress(0.0, "Weighing errors"):
                raise Cancelled
            for targets, found in pool.map(block, parts[group : group + _THREADS]):
                file.write(memoryview(targets).cast("B"))
                sums += found
    norm, error, energy = sums
    return float(norm), float(error / energy) if energy else 1.0


class _Rounds:
    """The last round's model on disk, from which a fit goes on after it was killed."""

    def __init__(self, state: Path | None, dataset: Dataset, settings: Mapping[str, Any]) -> None:
        self._state = state
        self._dataset = dataset
        same = {key: value for key, value in settings.items() if key not in ("threads", "memory")}
        said = {**same, "weights": "lightness"}
        self._checkpoint = None if state is None else Checkpoint(state, said, dataset)

    def within(self, number: int) -> Path | None:
        """Where the fit of a round keeps its own state."""
        return self._state and self._state.with_name(f"{self._state.name}.{number}")

    def save(self, model: ClusteredTucker, errors: list[float]) -> None:
        """Keep a round's model, unless rounds are so short that they are soon made again."""
        if self._checkpoint is None:
            return
        self._checkpoint.save(
            {
                "core": model.core,
                "basis": [model.bases[mode] for mode in MODES],
                "members": {MODES.index(mode): rows for mode, rows in model.members.items()},
                "clusters": dict(model.clusters),
                "fit": dict(model.fit),
                "rounds": errors,
            }
        )

    def load(self) -> tuple[ClusteredTucker | None, list[float]]:
        """The model to go on from and its rounds' errors, or None and none."""
        kept = self._checkpoint.load() if self._checkpoint else None
        if kept is None:
            return None, []
        model = ClusteredTucker(
            core=kept["core"],
            bases=dict(zip(MODES, kept["basis"], strict=True)),
            members={MODES[mode]: rows for mode, rows in kept["members"].items()},
            clusters=kept["clusters"],
            dataset=describe(self._dataset),
            fit=kept["fit"],
        )
        return model, kept["rounds"]

    def remove(self) -> None:
        """Forget it."""
        if self._checkpoint is not None:
            self._checkpoint.remove()
        for within in filter(None, map(self.within, _FRESH)):
            within.unlink(missing_ok=True)
