"""What a target can be, a quality or a file size, and how good a fit is for it.

`squared_norm` is sum A^2 of the dataset, known once its samples have been read.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, log, log10
from pathlib import Path

from ..datasets.dataset import Dataset
from .clustered_tucker import ClusteredTucker
from .landing import MOST, USUAL, land_on_bytes, land_on_quality, share_at, size_at
from .precision import SHARE
from .rate_distortion import Regained, Truncations
from .steps import Progress

SPARE = (1.0, 0.5, 2.5)
"""How much rounding a truncation may be chosen to need, over the usual one."""
NEAR_DB = 0.1
"""A model this much above the target has reached it; one farther above is larger than need be."""
ROOM = 1600
"""Bytes of a file that are left for what it says of the search."""

_FLOOR = 1e-12  # relative error: 120 dB stand for none at all


def decibels(squared_error: float, squared_norm: float) -> float:
    """10 log10(squared norm / squared error)."""
    relative = squared_error / squared_norm if squared_error > 0.0 else 0.0
    return -10.0 * log10(max(relative, _FLOOR))


@dataclass(frozen=True)
class Quality:
    """A quality in dB, in as few bytes as possible."""

    snr_db: float
    squared_norm: float = 0.0

    @property
    def most(self) -> float:
        """The largest squared error that is good enough."""
        return self.squared_norm * 10.0 ** (-self.snr_db / 10.0)

    def shortlist(
        self, table: Truncations, regained: Regained, density: float, beside: int, count: int
    ) -> list[dict[str, int]]:
        """Ranks that seem to get there with the fewest numbers.

        density  bytes for a number
        beside   bytes for the rest of the file
        count    of ranks for each of SPARE
        """
        return [
            ranks
            for spare in SPARE
            for ranks in table.smallest(self.most / (1.0 + spare * USUAL), regained, count)
        ]

    def spare(self, squared_error: float, size: int) -> float:
        """The share of a fit's error that rounding adds on the way to the target.

        size  of the fit's file if it is rounded as usual
        """
        return self.most / squared_error - 1.0 if squared_error > 0.0 else inf

    def merit(self, squared_error: float, size: int, slope: float) -> float:
        """The logarithm of a fit's size once it is rounded to the target; the lower the better.

        slope  of the rate-distortion curve, for a fit that is not good enough: log bytes for a dB
        """
        spare = self.spare(squared_error, size)
        landed = log(size * size_at(min(max(spare, SHARE), MOST)))
        return landed - slope * min(10.0 * log10(max(1.0 + spare, _FLOOR)), 0.0)

    def order(self, size: int, reached_db: float) -> tuple[float, float]:
        """The lower the better: whether it is farther above the target than NEAR_DB, the bytes."""
        return float(reached_db > self.snr_db + NEAR_DB), size

    def land(
        self,
        model: ClusteredTucker,
        squared_error: float,
        dataset: Dataset,
        folder: Path,
        progress: Progress,
    ) -> tuple[ClusteredTucker, float] | None:
        """Round a fit to the target: the model and its quality in dB; None if that cannot be."""
        fit_db = decibels(squared_error, self.squared_norm)
        return land_on_quality(model, squared_error, fit_db, self.snr_db, dataset, folder, progress)


@dataclass(frozen=True)
class Size:
    """A file of at most `limit` bytes, as good as possible; see Quality."""

    limit: int
    squared_norm: float = 0.0

    @property
    def most(self) -> float:
        """Any error is good enough."""
        return inf

    def shortlist(
        self, table: Truncations, regained: Regained, density: float, beside: int, count: int
    ) -> list[dict[str, int]]:
        """Ranks that seem to fit in with the smallest errors."""
        found = []
        for spare in SPARE:
            room = self._room / size_at(spare * USUAL) - beside
            found += table.closest(room / density, regained, count)
        return found

    def spare(self, squared_error: float, size: int) -> float:
        """The share of a fit's error that rounding adds on the way to the target."""
        return share_at(self._room / size)

    def merit(self, squared_error: float, size: int, slope: float) -> float:
        """A fit's quality in dB, negative, once it is rounded to the target."""
        spare = min(max(self.spare(squared_error, size), SHARE), MOST)
        excess = max(log(size * size_at(spare) / self._room), 0.0)
        return excess / slope - decibels(squared_error * (1.0 + spare), self.squared_norm)

    def order(self, _size: int, reached_db: float) -> tuple[float, float]:
        """The lower the better: any size that fits in is near enough, then the quality."""
        return 0.0, -reached_db

    def land(
        self,
        model: ClusteredTucker,
        squared_error: float,
        dataset: Dataset,
        folder: Path,
        progress: Progress,
    ) -> tuple[ClusteredTucker, float] | None:
        """Round a fit to the target, or further to where only the dataset's own noise is lost."""
        landed = land_on_bytes(model, squared_error, self.limit, dataset, folder, progress)
        floor_db = dataset.noise_floor_db
        if landed is None or floor_db is None or landed[1] <= floor_db:
            return landed
        quiet = Quality(floor_db, self.squared_norm)
        return quiet.land(model, squared_error, dataset, folder, progress) or landed

    @property
    def _room(self) -> int:
        return max(self.limit - ROOM, 1)


Aim = Quality | Size
