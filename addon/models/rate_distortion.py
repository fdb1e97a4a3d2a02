"""Every truncation of a fitted model at once: the error it has and the numbers it stores.

Bases are orthonormal and their columns come by falling energy (HOSVD), so what a truncated core
keeps is a sum over one of its corners: all of them are one cumulative sum (De Lathauwer et al.
2000, property 10).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import log

import numpy as np
from numpy.typing import NDArray

from .clustered_tucker import ClusteredTucker

_SLOPE = 0.5  # of measured materials: 0.4 to 0.7


@dataclass(frozen=True)
class Regained:
    """What a fit at smaller ranks wins back of a truncation's loss, as shares of it: little in
    modes whose basis is global, more in those where each cluster has its own."""

    shared: float = 0.0
    own: float = 0.0


LOST = Regained()
"""Nothing is regained: the truncation itself."""


@dataclass(frozen=True)
class Truncations:
    """The truncations of a model's core, one entry of each array for each.

    ranks    for each mode in axis order, the ranks to choose from, ascending
    shared   squared norm that falls away with the columns of global bases, float64
    own      what falls away in addition with those of the clusters' own bases; sums over clusters,
             as if these did not overlap
    numbers  how many numbers the core and the bases then have
    error    sum (A - A^)^2 of the model as it is
    """

    ranks: Mapping[str, NDArray[np.intp]]
    shared: NDArray[np.float64]
    own: NDArray[np.float64]
    numbers: NDArray[np.int64]
    error: float

    def errors(self, regained: Regained) -> NDArray[np.float64]:
        """Squared errors, about, of fits at the smaller ranks; exact for a truncated N-SVD."""
        lost = (1.0 - regained.shared) * self.shared + (1.0 - regained.own) * self.own
        return self.error + lost

    def learn(self, ranks: Mapping[str, int], regained: Regained, error: float) -> Regained:
        """What is regained so that the error at some ranks is the one that a fit has had."""
        shared, own = (float(lost[self._place(ranks)]) for lost in (self.shared, self.own))
        expected = regained.shared * shared + regained.own * own
        if expected <= 0.0:
            return regained
        scale = min(max((self.error + shared + own - error) / expected, -3.0), 5.0)
        return Regained(min(scale * regained.shared, 0.9), min(scale * regained.own, 0.9))

    def smallest(self, error: float, regained: Regained, count: int) -> list[dict[str, int]]:
        """Ranks whose squared error is at most `error`: those with the fewest numbers."""
        errors = self.errors(regained)
        return self._first(self.numbers, errors, errors <= error, count)

    def closest(self, numbers: float, regained: Regained, count: int) -> list[dict[str, int]]:
        """Ranks with at most this many numbers: those with the smallest errors."""
        return self._first(self.errors(regained), self.numbers, self.numbers <= numbers, count)

    @property
    def least(self) -> dict[str, int]:
        """The ranks of the smallest truncation."""
        return {mode: int(choices[0]) for mode, choices in self.ranks.items()}

    def error_at(self, ranks: Mapping[str, int], regained: Regained = LOST) -> float:
        """The squared error at some of the ranks to choose from."""
        return float(self.errors(regained)[self._place(ranks)])

    def numbers_at(self, ranks: Mapping[str, int]) -> int:
        """How many numbers there are at some of the ranks to choose from."""
        return int(self.numbers[self._place(ranks)])

    def _place(self, ranks: Mapping[str, int]) -> tuple[int, ...]:
        return tuple(int(np.searchsorted(self.ranks[mode], ranks[mode])) for mode in self.ranks)

    def slope(self, ranks: Mapping[str, int]) -> float:
        """How the logarithm of the numbers grows with each dB about some ranks."""
        error = self.error_at(ranks)
        less, more = (self.smallest(error * 10.0**step, LOST, 1) for step in (0.1, -0.1))
        if not less or not more:
            return _SLOPE
        growth = log(self.numbers_at(*more) / self.numbers_at(*less)) / 2.0
        return min(max(growth, _SLOPE / 3.0), _SLOPE * 3.0)

    def _first(
        self, wanted: NDArray, then: NDArray, allowed: NDArray[np.bool_], count: int
    ) -> list[dict[str, int]]:
        """The first in the order of `wanted`, ties in that of `then`, one for each rank of x.

        Their files differ more than their numbers: a part of a file is as wide as that rank, and
        narrow ones are packed badly.
        """
        places = np.flatnonzero(allowed)
        places = places[np.lexsort((then.flat[places], wanted.flat[places]))]
        _, first = np.unique(places % allowed.shape[-1], return_index=True)
        found = np.stack(np.unravel_index(places[np.sort(first)[:count]], allowed.shape), axis=1)
        return [
            {
                mode: int(choices[place])
                for (mode, choices), place in zip(self.ranks.items(), row, strict=True)
            }
            for row in found
        ]


def truncations(model: ClusteredTucker, squared_error: float) -> Truncations:
    """The truncations of a model whose squared error is known; clustered modes keep their ranks."""
    ranks = {
        mode: np.array([rank]) if mode in model.clusters else rank_choices(mode, rank)
        for mode, rank in model.ranks.items()
    }
    # Only the corners that `ranks` names are wanted: sums over the blocks between them, cluster by
    # cluster, take little memory.
    blocks = np.zeros([len(choices) for choices in ranks.values()])
    starts = [np.concatenate([[0], choices[:-1]]) for choices in ranks.values()]
    for core in model.core:
        for place, first in enumerate(starts[0]):
            block = np.square(core[first : [*ranks.values()][0][place]], dtype=float).sum(axis=0)
            for axis, begin in enumerate(starts[1:]):
                block = np.add.reduceat(block, begin, axis=axis)
            blocks[place] += block
    kept = blocks
    for axis in range(kept.ndim):
        kept = kept.cumsum(axis=axis)
    grid = np.meshgrid(*ranks.values(), indexing="ij")
    numbers = len(model.core) * np.prod(grid, axis=0, dtype=np.int64)
    for mode, rank in zip(ranks, grid, strict=True):
        owners, rows, mixtures, _ = model.bases[mode].shape
        numbers = numbers + owners * rows * mixtures * rank
    # With every column of the clusters' own bases only those of global ones are missing.
    whole = kept
    for axis, mode in enumerate(ranks):
        if len(model.bases[mode]) > 1:
            whole = whole.take([-1], axis=axis)
    whole = np.broadcast_to(whole, kept.shape)
    return Truncations(ranks, kept.flat[-1] - whole, whole - kept, numbers, squared_error)


def rank_choices(mode: str, largest: int) -> NDArray[np.intp]:
    """Ranks of a mode to choose from: small ones, multiples of 4, and the largest.

    Four numbers are fetched at a time (K-CTA, Section 6). The x and y modes are expanded before
    that, and there every rank will do, as long as one more makes a difference.
    """
    single = 32 if mode in ("y", "x") else 8
    return np.unique([*range(1, min(single, largest) + 1), *range(4, largest + 1, 4), largest])


def truncate(model: ClusteredTucker, ranks: Mapping[str, int]) -> ClusteredTucker:
    """The model with only the first columns of its bases."""
    corner = tuple(slice(ranks[mode]) for mode in model.ranks)
    return replace(
        model,
        core=np.ascontiguousarray(model.core[:, *corner]),
        bases={
            mode: np.ascontiguousarray(basis[..., : ranks[mode]])
            for mode, basis in model.bases.items()
        },
    )
