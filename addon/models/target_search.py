"""The search for ranks and numbers of clusters that suit a target; see `target`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import ceil, inf, prod
from pathlib import Path
from typing import Any

from ..datasets.dataset import Dataset
from .aims import Aim, Quality, decibels
from .cluster_walk import walk
from .clustered_tucker import ClusteredTucker
from .fit import compress, describe
from .landing import USUAL, saved_bytes
from .precision import round_model
from .rate_distortion import LOST, Regained, Truncations, truncate, truncations
from .reduced import BYTES_A_NUMBER, Reduced, first_ranks, larger_ranks, reduce_dataset
from .steps import Steps

CLUSTERED: dict[str, tuple[str, ...]] = {
    "nsvd": (),
    "cta": ("view",),
    "kcta": ("view",),
    "mkcta": ("light", "view"),
}
"""The modes that each method clusters, as far as a dataset has them."""
RANK = 4
"""Of a clustered mode, in each cluster (K-CTA, Section 6)."""
MIXTURES = {"cta": 1, "kcta": 3, "mkcta": 3}
"""More gain next to nothing (MK-CTA, Section 4.3)."""

_GENEROUS = 1.5  # ranks of a trial's fit over those that are expected to be best
_REGAINED = Regained(0.02)  # by an N-SVD; of measured materials, about
_REGAINED_OF_CLUSTERS = Regained(0.1, 0.3)
_TRIALS = 8  # numbers of clusters
_FITS = 4  # at the chosen ranks
_SAVED, _SAVED_BYTES = 6, 2**23  # truncations that are saved, times three, and all their files
_NEAR = (USUAL / 3.0, USUAL * 3.0)  # rounding that costs next to no bytes for the quality it takes
_CLUSTERS_COST = 3.0  # dB that clusters may cost at a given size, at the very most


@dataclass(frozen=True)
class Fitted:
    """A model of the dataset before rounding, its squared error, and its size rounded as usual."""

    model: ClusteredTucker
    squared_error: float
    bytes: int


@dataclass(frozen=True)
class Trial:
    """A fit's truncations, and the one among them that seems best for the target."""

    model: ClusteredTucker
    table: Truncations
    ranks: dict[str, int]


@dataclass
class Search:
    """One search and what it has found out.

    options   of every fit
    slope     of the rate-distortion curve: log bytes for a dB
    density   bytes for a number, the description aside
    regained  see Truncations.errors
    walked    the points of the curve that were looked at
    reduced   what the fits are made to
    best      the last or the best trial
    """

    dataset: Dataset
    method: str
    aim: Aim
    folder: Path
    options: Mapping[str, Any]
    steps: Steps
    slope: float = 0.5
    density: float = 1.0
    regained: Regained = LOST
    walked: list[dict[str, Any]] = field(default_factory=list)
    reduced: Reduced = field(init=False)
    best: Trial = field(init=False)

    @property
    def clustered(self) -> tuple[str, ...]:
        """The modes with clusters."""
        return tuple(mode for mode in CLUSTERED[self.method] if mode in self.dataset.axes)

    def begin(self) -> None:
        """N-SVD at ranks enough for the target, and what it tells of the rest."""
        memory = self.options["memory"]
        ranks: dict[str, int] = {}
        larger = first_ranks(self.dataset, self.clustered, memory)
        while larger != ranks:
            ranks = larger
            self.reduced = reduce_dataset(
                self.dataset,
                ranks,
                self.clustered,
                scratch=self.folder,
                threads=self.options["threads"],
                memory=memory,
                progress=self.steps.step(_TRIALS if self.clustered else 3),
            )
            self.aim = replace(self.aim, squared_norm=self.reduced.squared_norm)
            start = self.untried(self.reduced.nsvd, self.reduced.lost)
            self.best, error = start, self.aim.most
            for _ in range(2):  # with guesses of density and slope, and with what they are
                found = self.choose(start)
                if found is not None:
                    self.best, _ = found
                    self.slope = start.table.slope(self.best.ranks)
                    error = start.table.error_at(self.best.ranks)
                    self.heed_noise(error)
            larger = larger_ranks(self.reduced, self.best.ranks if found else {}, error)
            if memory and BYTES_A_NUMBER * prod(larger.values()) > memory:
                break

    def heed_noise(self, squared_error: float) -> None:
        """Aim at the dataset's own noise where a size has room for more than that.

        `squared_error` is an N-SVD's of the size.
        """
        floor_db = self.dataset.noise_floor_db
        if isinstance(self.aim, Quality) or floor_db is None:
            return
        if self.decibels(squared_error) > floor_db + _CLUSTERS_COST:  # any method gets there
            self.aim = Quality(floor_db, self.aim.squared_norm)

    def walk(self) -> None:
        """The best numbers of clusters, from where C_n R_n is N-SVD's rank."""
        if not self.clustered:
            self.sketch()
            self.regained = _REGAINED
            return
        self.regained = _REGAINED_OF_CLUSTERS
        most = {mode: self.dataset.sizes[mode] for mode in self.clustered}
        start = {m: min(max(1, round(self.best.ranks[m] / RANK)), most[m]) for m in most}
        trials: dict[tuple[int, ...], Trial] = {}

        def merit(clusters: dict[str, int]) -> float:
            self.best, found = self.trial(clusters, max(_TRIALS - len(trials), 3))
            trials[tuple(clusters.values())] = self.best
            return found

        best = walk(merit, start, dict.fromkeys(most, 1), most, _TRIALS)
        self.best = trials[tuple(best.values())]

    def sketch(self) -> None:
        """The curve about the best truncation of the N-SVD, which needs no fits."""
        trial = self.best
        for step in (-2.0, -1.0, 1.0, 2.0):
            error = trial.table.error_at(trial.ranks) * 10.0 ** (-step / 10.0)
            for ranks in trial.table.smallest(error, LOST, 1):
                error = trial.table.error_at(ranks)
                self.note(truncate(trial.model, ranks), error)

    def fit(self) -> list[Fitted]:
        """Fits at the best ranks, the best first, of which rounding brings some to the target.

        Two that it brings there are enough: estimates are off by a few percent.
        """
        found: dict[tuple[int, ...], Fitted] = {}
        trial, candidates = self.best, [self.best.ranks]
        near = 0
        while candidates and len(found) < _FITS and near < 2:
            ranks, clusters = candidates[0], trial.model.clusters
            fitted = self.fitted(ranks, clusters, _FITS - len(found) + 1)
            found[(*clusters.values(), *ranks.values())] = fitted
            near += _NEAR[0] < self.aim.spare(fitted.squared_error, fitted.bytes) < _NEAR[1]
            self.regained = trial.table.learn(ranks, self.regained, fitted.squared_error)
            judged = self.judge(trial)
            if not judged and clusters and self.aim.most < inf:  # these do not reach the target
                items = self.dataset.sizes
                more = {m: min(items[m], ceil(1.2 * count)) for m, count in clusters.items()}
                trial, _ = self.trial(more, _FITS - len(found) + 1)
                clusters, judged = trial.model.clusters, [(0.0, trial.ranks)]
            candidates = [
                ranks for _, ranks in judged if (*clusters.values(), *ranks.values()) not in found
            ]
        return sorted(found.values(), key=lambda one: self.merit(one.squared_error, one.bytes))

    def choose(self, trial: Trial) -> tuple[Trial, float] | None:
        """The truncation of a fit that is best for the target, as far as is known, and its merit.

        None where the target is out of reach.
        """
        judged = self.judge(trial)
        return (replace(trial, ranks=judged[0][1]), judged[0][0]) if judged else None

    def judge(self, trial: Trial) -> list[tuple[float, dict[str, int]]]:
        """The truncations of a fit that may be best for the target, the best one first.

        Numbers tell only about how large a file is: the first few truncations are saved.
        """
        table = trial.table
        beside = len(json.dumps(describe(self.dataset)))
        shortlist = self.aim.shortlist(table, self.regained, self.density, beside, _SAVED)
        judged = []
        for ranks in {tuple(ranks.values()): ranks for ranks in shortlist}.values():
            error = table.error_at(ranks, self.regained)
            size = self.measure(truncate(trial.model, ranks), error)
            judged.append((self.merit(error, size), size, ranks))
            if size * len(judged) > _SAVED_BYTES:
                break
        judged.sort(key=lambda one: one[0])
        if judged:
            _, size, ranks = judged[0]
            self.density = max(size - beside, 1) / table.numbers_at(ranks)
        return [(merit, ranks) for merit, _, ranks in judged]

    def trial(self, clusters: dict[str, int], left: int) -> tuple[Trial, float]:
        """A fit at ranks above those of the last trial, and the merit of its best truncation."""
        most = self.reduced.ranks
        ranks = {m: min(most[m], 4 * ceil(_GENEROUS * r / 4)) for m, r in self.best.ranks.items()}
        fitted = self.fitted(ranks, clusters, left)
        trial = self.untried(fitted.model, fitted.squared_error)
        return self.choose(trial) or (trial, self.merit(fitted.squared_error, fitted.bytes))

    def untried(self, model: ClusteredTucker, squared_error: float) -> Trial:
        """A fit whose best truncation is unknown: the one that comes nearest to any target."""
        table = truncations(model, squared_error)
        return Trial(model, table, table.least if self.aim.most == inf else model.ranks)

    def fitted(self, ranks: Mapping[str, int], clusters: Mapping[str, int], left: int) -> Fitted:
        """A fit; with it about `left` parts of the work are left."""
        settings: dict[str, Any] = {"ranks": dict(ranks)}
        if clusters:
            most = MIXTURES[self.method]
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
        return Fitted(model, error, self.note(model, error))

    def note(self, model: ClusteredTucker, squared_error: float) -> int:
        """Keep where a model is on the curve if it is rounded as usual; the size of its file."""
        size = self.measure(model, squared_error)
        self.walked.append(point(model, self.decibels(squared_error * (1.0 + USUAL)), size))
        return size

    def measure(self, model: ClusteredTucker, squared_error: float) -> int:
        """The size of a model's file if it is rounded as usual."""
        return saved_bytes(round_model(model, squared_error, USUAL), self.folder)

    def merit(self, squared_error: float, size: int) -> float:
        """See Aim."""
        return self.aim.merit(squared_error, size, self.slope)

    def decibels(self, squared_error: float) -> float:
        """A quality in dB."""
        return decibels(squared_error, self.reduced.squared_norm)


def point(model: ClusteredTucker, snr_db: float, size: int) -> dict[str, Any]:
    """A place on the rate-distortion curve."""
    return {
        "ranks": model.ranks,
        "clusters": dict(model.clusters),
        "mixtures": model.mixtures,
        "snr_db": round(snr_db, 3),
        "bytes": size,
    }
