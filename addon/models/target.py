"""Ranks, clusters and mixtures for a quality or a file size, without anyone choosing them.

After MK-CTA, Section 4.3: an N-SVD first, whose core gives the error at every rank; then clusters
such that C_n R_n is N-SVD's rank, with R_n = 4 and K_n = 3. From there the numbers of clusters walk
to where the file is smallest; one fit at generous ranks for each shows the best ranks there.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import ceil, floor, inf, log, log10
from pathlib import Path
from typing import Any

from ..datasets.dataset import Dataset
from ..errors import NacreError
from .cluster_walk import walk
from .clustered_tucker import ClusteredTucker
from .fit import METHODS, compress, describe
from .landing import (
    MOST,
    USUAL,
    land_on_bytes,
    land_on_quality,
    saved_bytes,
    share_at,
    size_at,
)
from .precision import SHARE, round_model
from .rate_distortion import Truncations, truncate, truncations
from .reduced import first_ranks, larger_ranks, reduce_dataset
from .steps import Progress, Steps

CLUSTERED: dict[str, tuple[str, ...]] = {
    "nsvd": (),
    "cta": ("view",),
    "kcta": ("view",),
    "mkcta": ("light", "view"),
}
"""The modes that each method clusters."""
RANK = 4
"""Of a clustered mode, in each cluster (K-CTA, Section 6)."""
MIXTURES = 3
"""More gain next to nothing (MK-CTA, Section 4.3)."""

_GENEROUS = 1.5  # ranks of a trial's fit over those that are expected to be best
_REGAINED = 0.25  # of a truncation's loss, by a fit at the smaller ranks, where there are clusters
_TRIALS = 8  # numbers of clusters
_FITS = 4  # at the chosen ranks
_SPARE = (1.0, 0.4, 2.5)  # times the usual rounding: what a truncation may leave to it
_SAVED, _SAVED_BYTES = 4, 2**23  # truncations for each that are saved, and all their files
_CURVE_BYTES = 1500  # of the description, for the curve
_CLUSTERS_COST = 3.0  # dB that clusters may cost at a given size, at the very most
_ROOM = 64  # bytes for digits of the description that change after a file was measured
_HALF_FLOATS = 66.0  # dB that the file's 16-bit numbers allow, about
_TINY = 1e-30
_LEAST = 1e-12  # relative error: 120 dB stand for none at all


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

    The rest is as for `compress`. The model's `fit` has its quality, and as `rate_distortion` the
    fits that were looked at. Raises NacreError for a target that cannot be reached, Cancelled on
    request.
    """
    _check(dataset, method, snr_db, megabytes)
    target = {"snr_db": snr_db, "megabytes": megabytes}
    work = _Search(
        dataset,
        method,
        {name: value for name, value in target.items() if value is not None},
        snr_db or 0.0,
        None if megabytes is None else int(megabytes * 1e6) - _CURVE_BYTES,
        folder,
        {
            "global_modes": global_modes,
            "search": search,
            "seed": seed,
            "threads": threads,
            "memory": memory,
        },
        Steps(progress),
    )
    work.begin()
    work.walk()
    return work.land(work.fit())


@dataclass(frozen=True)
class _Fitted:
    """A model of the dataset before rounding, its squared error, and its size rounded as usual."""

    model: ClusteredTucker
    squared_error: float
    bytes: int


@dataclass(frozen=True)
class _Trial:
    """A fit's truncations, and the one among them that seems best."""

    model: ClusteredTucker
    table: Truncations
    ranks: dict[str, int]


@dataclass
class _Search:
    """One search and what it has found out.

    target         what the user asked for
    limit          of a file's bytes, its curve aside, or None if the aim is the quality `snr_db`
    slope          of the curve: log bytes for a dB
    density        bytes for a number, the description aside
    regained       see Truncations.errors
    walked         each fit in a few words
    """

    dataset: Dataset
    method: str
    target: dict[str, float]
    snr_db: float
    limit: int | None
    folder: Path
    options: Mapping[str, Any]
    steps: Steps
    started: float = field(default_factory=time.monotonic)
    slope: float = 0.5
    density: float = 1.0
    regained: float = 0.0
    walked: list[dict[str, Any]] = field(default_factory=list)

    def begin(self) -> None:
        """N-SVD, at ranks enough for the target, and what it tells of the rest."""
        ranks: dict[str, int] = {}
        shared = {name: self.options[name] for name in ("threads", "memory")}
        larger = first_ranks(self.dataset, self.clustered, self.options["memory"])
        while larger != ranks:
            ranks = larger
            self.reduced = reduce_dataset(
                self.dataset,
                ranks,
                self.clustered,
                **shared,
                scratch=self.folder,
                progress=self.steps.step(_TRIALS if self.clustered else 3),
            )
            nsvd = self.reduced.nsvd
            start = self.untried(nsvd, self.reduced.lost)
            self.best, error = start, self.most
            for _ in range(2):  # with guesses of density and slope, and with what they are
                found = self.choose(start)
                if found is not None:
                    self.best, _ = found
                    self.slope = start.table.slope(self.best.ranks)
                    error = start.table.error_at(self.best.ranks, 0.0)
                self.heed_noise(error)
            larger = larger_ranks(self.reduced, self.best.ranks if found else {}, error)

    def heed_noise(self, squared_error: float) -> None:
        """Aim at the dataset's own noise where the size has room for more than that.

        `squared_error` is an N-SVD's of the size.
        """
        floor_db = self.dataset.noise_floor_db
        if self.limit is None or floor_db is None:
            return
        if self.decibels(squared_error) > floor_db + _CLUSTERS_COST:  # any method gets there
            self.limit, self.snr_db = None, floor_db

    def walk(self) -> None:
        """The best numbers of clusters, from where C_n R_n is N-SVD's rank."""
        if not self.clustered:
            self.sketch()
            return
        self.regained = _REGAINED
        most = {mode: self.items[mode] for mode in self.clustered}
        start = {m: min(max(1, round(self.best.ranks[m] / RANK)), most[m]) for m in self.clustered}
        trials: dict[tuple[int, ...], _Trial] = {}

        def merit(clusters: dict[str, int]) -> float:
            self.best, found = self.trial(clusters, max(_TRIALS - len(trials), 3))
            trials[tuple(clusters.values())] = self.best
            return found

        found = walk(merit, start, dict.fromkeys(self.clustered, 1), most, _TRIALS)
        self.best = trials[tuple(found.values())]

    def sketch(self) -> None:
        """The curve about the best truncation of the N-SVD, which needs no fits."""
        trial = self.best
        for decibels in (-2.0, -1.0, 1.0, 2.0):
            error = trial.table.error_at(trial.ranks, 0.0) * 10.0 ** (-decibels / 10.0)
            for ranks in trial.table.smallest(error, 0.0, 1):
                error = trial.table.error_at(ranks, 0.0)
                model = truncate(trial.model, ranks)
                self.note(model, error, self.measure(model, error))

    def note(self, model: ClusteredTucker, squared_error: float, size: int) -> None:
        """Keep where a model is on the curve if it is rounded as usual."""
        self.walked.append(_point(model, self.decibels(squared_error * (1.0 + USUAL)), size))

    def fit(self) -> list[_Fitted]:
        """Fits at the best ranks, until rounding can do the rest of the way to the target."""
        found: dict[tuple[int, ...], _Fitted] = {}
        for number in range(_FITS):
            trial, left = self.best, _FITS - number + 1
            clusters = trial.model.clusters
            key = (*clusters.values(), *trial.ranks.values())
            if key in found:
                break
            found[key] = self.fitted(trial.ranks, clusters, left)
            if self.is_near(found[key]):
                break
            loss = trial.table.error_at(trial.ranks, 0.0) - trial.table.error
            if loss > 0.0:
                gain = loss + trial.table.error - found[key].squared_error
                self.regained = min(gain / loss, 1.0)
            better = self.choose(trial)
            if better is not None:
                self.best, _ = better
            elif self.limit is None and clusters:  # these do not reach the target
                more = {m: min(self.items[m], ceil(1.2 * c)) for m, c in clusters.items()}
                self.best, _ = self.trial(more, left)
        return [*found.values()]

    def land(self, found: list[_Fitted]) -> ClusteredTucker:
        """Round the best of some fits to the target. Raises NacreError where none gets there."""
        best_first = sorted(found, key=lambda one: self.merit(one.squared_error, one.bytes))
        for number, fitted in enumerate(best_first):
            error, fit_db = fitted.squared_error, self.decibels(fitted.squared_error)
            seconds = round(time.monotonic() - self.started, 3)
            model = self.described(fitted.model, fit_db, fitted.bytes, seconds)
            rest = (self.dataset, self.folder, self.steps.step(len(found) - number))
            if self.limit is None:
                landed = land_on_quality(model, error, fit_db, self.snr_db, *rest)
            else:
                limit = self.limit + _CURVE_BYTES - _ROOM
                landed = land_on_bytes(model, error, limit, *rest)
                floor_db = self.dataset.noise_floor_db
                if landed is not None and floor_db is not None and landed[1] > floor_db:
                    landed = land_on_quality(model, error, fit_db, floor_db, *rest) or landed
            if landed is not None:
                model, snr_db = landed
                seconds = round(time.monotonic() - self.started, 3)
                size = fitted.bytes
                for _ in range(3):  # the size is in the file, and its digits count
                    model = self.described(model, snr_db, size, seconds)
                    size = saved_bytes(model, self.folder)
                return self.described(model, snr_db, size, seconds)
        raise self.out_of_reach(found)

    def choose(self, trial: _Trial) -> tuple[_Trial, float] | None:
        """The truncation that is best for the target, as far as is known, and its merit.

        Numbers say only about how large a file is, so that the first few truncations are saved.
        None where the target is out of reach.
        """
        table, found = trial.table, []
        for spare in _SPARE:
            if self.limit is None:
                enough = self.most / (1.0 + spare * USUAL)
                found += table.smallest(enough, self.regained, _SAVED)
            else:
                room = (self.limit / size_at(spare * USUAL) - self.beside) / self.density
                found += table.closest(room, self.regained, _SAVED)
        judged = []
        for ranks in {tuple(ranks.values()): ranks for ranks in found}.values():
            error = table.error_at(ranks, self.regained)
            size = self.measure(truncate(trial.model, ranks), error)
            judged.append((self.merit(error, size), size, ranks))
            if size * len(judged) > _SAVED_BYTES:
                break
        if not judged:
            return None
        merit, size, ranks = min(judged, key=lambda one: one[0])
        self.density = (size - self.beside) / table.numbers_at(ranks)
        return replace(trial, ranks=ranks), merit

    def untried(self, model: ClusteredTucker, squared_error: float) -> _Trial:
        """A fit whose best truncation is unknown: the one that comes nearest to any target."""
        table = truncations(model, squared_error)
        return _Trial(model, table, model.ranks if self.limit is None else table.least)

    def trial(self, clusters: dict[str, int], left: int) -> tuple[_Trial, float]:
        """A fit at ranks above those of the last trial, and the merit of its best truncation."""
        most = self.reduced.ranks
        ranks = {m: min(most[m], 4 * ceil(_GENEROUS * r / 4)) for m, r in self.best.ranks.items()}
        fitted = self.fitted(ranks, clusters, left)
        trial = self.untried(fitted.model, fitted.squared_error)
        return self.choose(trial) or (trial, self.merit(fitted.squared_error, fitted.bytes))

    def fitted(self, ranks: Mapping[str, int], clusters: Mapping[str, int], left: int) -> _Fitted:
        """A fit; about `left` parts of the work are left with it."""
        settings: dict[str, Any] = {"ranks": dict(ranks)}
        if clusters:
            most = 1 if self.method == "cta" else MIXTURES
            settings["ranks"] |= {mode: min(RANK, self.reduced.ranks[mode]) for mode in clusters}
            settings["clusters"] = dict(clusters)
            settings["mixtures"] = {mode: min(most, count) for mode, count in clusters.items()}
        model = self.reduced.restore(
            compress(
                self.reduced.dataset,
                self.method,
                **settings,
                **self.options,
                progress=self.steps.step(left),
            )
        )
        error = model.fit["errors"][-1] * self.reduced.squared_norm
        size = self.measure(model, error)
        self.note(model, error, size)
        return _Fitted(model, error, size)

    def measure(self, model: ClusteredTucker, squared_error: float) -> int:
        """The size of a model's file if it is rounded as usual."""
        return saved_bytes(round_model(model, squared_error, USUAL), self.folder)

    def merit(self, squared_error: float, size: int) -> float:
        """How good a fit will be once it is rounded to the target; the lower the better.

        squared_error  before rounding
        size           in bytes if it is rounded as usual
        Either the logarithm of the size at the wanted quality, or the error in dB at the wanted
        size. What no rounding brings to the target is judged along the curve.
        """
        if self.limit is None:
            share = self.most / max(squared_error, _TINY) - 1.0
            lacking = max(-10.0 * log10(max(1.0 + share, _TINY)), 0.0)
            landed = log(size * size_at(min(max(share, SHARE), MOST)))
            return landed + self.slope * lacking
        share = min(max(share_at(self.limit / size), SHARE), MOST)
        excess = max(log(size * size_at(share) / self.limit), 0.0)
        return excess / self.slope - self.decibels(squared_error * (1.0 + share))

    def is_near(self, fitted: _Fitted) -> bool:
        """Whether rounding gets a fit to the target, and not by much more or less than usual."""
        if self.limit is None:
            share = self.most / max(fitted.squared_error, _TINY) - 1.0
        else:
            share = share_at(self.limit / fitted.bytes)
        return USUAL / 2.0 < share < USUAL * 2.5

    def described(
        self, model: ClusteredTucker, snr_db: float, size: int, seconds: float
    ) -> ClusteredTucker:
        """A model that says how it was made, how good it is, and where that is on the curve."""
        curve = [*self.walked, _point(model, snr_db, size)]
        kept = ("method", "search", "seed", "iterations", "errors")
        fit = {
            **{key: model.fit[key] for key in kept},
            "snr_db": round(snr_db, 4),
            "seconds": seconds,
            "target": self.target,
            "rate_distortion": sorted(curve, key=lambda point: point["bytes"]),
        }
        return replace(model, fit=fit)

    def out_of_reach(self, found: list[_Fitted]) -> NacreError:
        """What a user is told whose target none of the fits reaches."""
        name = self.dataset.path.name
        if self.limit is not None:
            least = min(fitted.bytes for fitted in found) + _CURVE_BYTES
            return NacreError(
                f"{name}: no {self.method} model fits in {self.target['megabytes']:g} MB; the "
                f"smallest takes about {least / 1e6:.3f} MB"
            )
        most = max(self.decibels(fitted.squared_error) for fitted in found)
        return NacreError(
            f"{name}: {self.method} does not reach {self.snr_db:g} dB; give --target-db "
            f"{floor(10.0 * min(most, _HALF_FLOATS)) / 10.0 - 0.1:g} or less"
        )

    def decibels(self, squared_error: float) -> float:
        """A quality in dB."""
        relative = squared_error / self.reduced.squared_norm if squared_error > 0.0 else 0.0
        return -10.0 * log10(max(relative, _LEAST))

    @property
    def beside(self) -> int:
        """About how many bytes a file has beside its numbers."""
        return len(json.dumps(describe(self.dataset)))

    @property
    def clustered(self) -> tuple[str, ...]:
        """The modes that the method clusters, as far as the dataset has them."""
        return tuple(mode for mode in CLUSTERED[self.method] if mode in self.dataset.axes)

    @property
    def items(self) -> dict[str, int]:
        """How many members clusters may have; the colour rows of a light are one."""
        return self.dataset.sizes

    @property
    def most(self) -> float:
        """The largest squared error that is good enough."""
        if self.limit is not None:
            return inf
        return self.reduced.squared_norm * 10.0 ** (-self.snr_db / 10.0)


def _point(model: ClusteredTucker, snr_db: float, size: int) -> dict[str, Any]:
    """A place on the rate-distortion curve."""
    return {
        "ranks": model.ranks,
        "clusters": dict(model.clusters),
        "mixtures": model.mixtures,
        "snr_db": round(snr_db, 3),
        "bytes": size,
    }


def _check(dataset: Dataset, method: str, snr_db: float | None, megabytes: float | None) -> None:
    """Raise NacreError for a target that no search need be made for."""
    if method not in METHODS:
        raise NacreError(f"method {method!r}: expected one of {', '.join(METHODS)}")
    if (snr_db is None) == (megabytes is None):
        raise NacreError("give a target quality or a target size, and not both")
    if snr_db is not None and snr_db > _HALF_FLOATS:
        raise NacreError(
            f"{dataset.path.name}: a model's 16-bit numbers do not reach {snr_db:g} dB; give "
            f"--target-db {_HALF_FLOATS:g} or less"
        )
    floor_db = dataset.noise_floor_db
    if snr_db is not None and floor_db is not None and snr_db > floor_db:
        raise NacreError(
            f"{dataset.path.name}: its own noise is at {floor_db:g} dB, and {snr_db:g} dB would "
            f"keep noise; give --target-db {floor_db:g} or less"
        )
