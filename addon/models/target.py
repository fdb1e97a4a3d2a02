"""Ranks, clusters and mixtures for a quality or a file size, without anyone choosing them.

After MK-CTA, Section 4.3: an N-SVD first, whose core gives the error at every rank; then clusters
such that C_n R_n is N-SVD's rank, with R_n = 4 and K_n = 3. From there the numbers of clusters walk
to where the file is smallest; one fit at generous ranks for each shows the best ranks there.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from ..datasets.dataset import Dataset
from ..errors import NacreError
from .aims import ROOM, Quality, Size
from .clustered_tucker import ClusteredTucker
from .fit import METHODS
from .landing import saved_bytes
from .steps import Progress, Steps
from .target_search import Search, point

_HALF_FLOATS = 66.0  # dB that the file's 16-bit numbers allow, about
_KEPT = ("method", "search", "seed", "iterations", "errors")  # of what a fit says
_LANDINGS = 2
_DIGITS = 64  # bytes for digits of the description that change after a file was measured


def compress_to_target(
    dataset: Dataset,
    method: str,
    *,
    snr_db: float | None = None,
    megabytes: float | None = None,
    folder: Path,
    global_modes: tuple[str, ...] | None = None,
    search: str = "auto",
    seed: int = 0,
    threads: int = 0,
    memory: int = 0,
    progress: Progress | None = None,
) -> ClusteredTucker:
    """Fit the smallest model of a quality, or the best one whose file has a size.

    snr_db     10 log10(sum A^2 / sum (A - A^)^2) of the saved model: reached, or little surpassed
    megabytes  10^6 bytes of the saved file, at most
    folder     where the model will be saved; files are measured there, and none is left

    The rest is as for `compress`. The model's `fit` has its quality, and as `rate_distortion` what
    was looked at on the way. Raises NacreError for a target that cannot be reached, Cancelled on
    request.
    """
    _check(dataset, method, snr_db, megabytes)
    started = time.monotonic()
    aim = Quality(snr_db) if snr_db is not None else Size(int((megabytes or 0.0) * 1e6) - _DIGITS)
    options = {
        "global_modes": global_modes,
        "search": search,
        "seed": seed,
        "threads": threads,
        "memory": memory,
    }
    work = Search(dataset, method, aim, folder, options, Steps(progress))
    work.begin()
    work.walk()
    found = work.fit()
    target = {"megabytes": megabytes} if snr_db is None else {"snr_db": snr_db}

    def described(model: ClusteredTucker, snr: float, size: int, seconds: float) -> ClusteredTucker:
        """The model with what is said of it."""
        curve = [*work.walked, point(model, snr, size)]
        said = {
            "snr_db": round(snr, 4),
            "seconds": round(seconds, 1),
            "target": target,
            "rate_distortion": sorted(curve, key=lambda one: one["bytes"]),
        }
        return replace(model, fit={**{key: model.fit[key] for key in _KEPT}, **said})

    # How far a fit is from its best file is known once it has landed: the first two are compared.
    best: tuple[tuple[float, float], ClusteredTucker] | None = None
    landings = 0
    for number, fitted in enumerate(found):
        # Only digits of the description change once the model has landed.
        fit_db = work.decibels(fitted.squared_error)
        model = described(fitted.model, fit_db, fitted.bytes, time.monotonic() - started)
        progress = work.steps.step(len(found) - number)
        landed = work.aim.land(model, fitted.squared_error, dataset, folder, progress)
        if landed is None:
            continue
        landings += 1
        model, reached = landed
        size, seconds = fitted.bytes, time.monotonic() - started
        for _ in range(2):
            size = saved_bytes(described(model, reached, size, seconds), folder)
        order: tuple[float, float] = work.aim.order(size, reached)
        if best is None or order < best[0]:
            best = order, described(model, reached, size, seconds)
        if landings >= _LANDINGS and best[0][0] == 0.0:
            break
    if best is not None:
        return best[1]
    name = dataset.path.name
    if snr_db is None:
        least = min(fitted.bytes for fitted in found) + ROOM
        raise NacreError(
            f"{name}: no {method} model fits in {megabytes:g} MB; the smallest takes about "
            f"{least / 1e6:.3f} MB"
        )
    closest = max(work.decibels(fitted.squared_error) for fitted in found)
    raise NacreError(
        f"{name}: {method} does not reach {snr_db:g} dB; give --target-db "
        f"{min(closest, _HALF_FLOATS) - 0.1:.1f} or less, or another --method"
    )


def _check(dataset: Dataset, method: str, snr_db: float | None, megabytes: float | None) -> None:
    """Raise NacreError for a target that no search need be made for."""
    name, floor_db = dataset.path.name, dataset.noise_floor_db
    if method not in METHODS:
        raise NacreError(f"method {method!r}: expected one of {', '.join(METHODS)}")
    if (snr_db is None) == (megabytes is None):
        raise NacreError("give a target quality or a target size, and not both")
    if snr_db is None:
        return
    if snr_db > _HALF_FLOATS:
        raise NacreError(
            f"{name}: a model's 16-bit numbers do not reach {snr_db:g} dB; give --target-db "
            f"{_HALF_FLOATS:g} or less"
        )
    if floor_db is not None and snr_db > floor_db:
        raise NacreError(
            f"{name}: its own noise is at {floor_db:g} dB, and {snr_db:g} dB would keep noise; "
            f"give --target-db {floor_db:g} or less"
        )
