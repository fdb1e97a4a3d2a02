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
class Truncations:
    """The truncations of a model's core, one entry of `kept` and `numbers` for each.

    ranks    for each mode in axis order, the ranks to choose from, ascending
    kept     squared norm of the truncated cores, summed over clusters, float64
    numbers  how many numbers the core and the bases then have
    error    sum (A - A^)^2 of the model as it is
    """

    ranks: Mapping[str, NDArray[np.intp]]
    kept: NDArray[np.float64]
    numbers: NDArray[np.int64]
    error: float

    def errors(self, regained: float) -> NDArray[np.float64]:
        """Squared errors, when a fit at the smaller ranks regains this share of what falls away.

        Clusters overlap where they are mixed; what that adds to the sum is part of `regained`.
        """
        return self.error + (1.0 - regained) * (self.kept.flat[-1] - self.kept)

    def smallest(self, error: float, regained: float, count: int) -> list[dict[str, int]]:
        """Ranks whose squared error is at most `error`: those with the fewest numbers first."""
        errors = self.errors(regained)
        return self._first(self.numbers, errors, errors <= error, count)

    def closest(self, numbers: float, regained: float, count: int) -> list[dict[str, int]]:
        """Ranks with at most this many numbers: those with the smallest errors first."""
        return self._first(self.errors(regained), self.numbers, self.numbers <= numbers, count)

    @property
    def least(self) -> dict[str, int]:
        """The ranks of the smallest truncation."""
        return {mode: int(choices[0]) for mode, choices in self.ranks.items()}

    def error_at(self, ranks: Mapping[str, int], regained: float) -> float:
        """The squared error at some of the ranks to choose from."""
        return float(self.errors(regained)[self._place(ranks)])

    def numbers_at(self, ranks: Mapping[str, int]) -> int:
        """How many numbers there are at some of the ranks to choose from."""
        return int(self.numbers[self._place(ranks)])

    def _place(self, ranks: Mapping[str, int]) -> tuple[int, ...]:
        return tuple(int(np.searchsorted(self.ranks[mode], ranks[mode])) for mode in self.ranks)

    def slope(self, ranks: Mapping[str, int]) -> float:
        """How the logarithm of the numbers grows with each dB about some ranks."""
        error = self.error_at(ranks, 0.0)
        less, more = (self.smallest(error * 10.0**step, 0.0, 1) for step in (0.1, -0.1))
        if not less or not more:
            return _SLOPE
        growth = log(self.numbers_at(*more) / self.numbers_at(*less)) / 2.0
        return min(max(growth, _SLOPE / 3.0), _SLOPE * 3.0)

    def _first(
        self, wanted: NDArray, then: NDArray, allowed: NDArray[np.bool_], count: int
    ) -> list[dict[str, int]]:
        places = np.flatnonzero(allowed)
        order = np.lexsort((then.flat[places], wanted.flat[places]))[:count]
        found = np.stack(np.unravel_index(places[order], allowed.shape), axis=1)
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
        mode: np.array([rank]) if mode in model.clusters else rank_choices(rank)
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
    return Truncations(ranks, kept, numbers, squared_error)


def rank_choices(largest: int) -> NDArray[np.intp]:
    """Multiples of 4 (K-CTA, Section 6), below them 1 to 3, and the largest itself."""
    return np.unique([*range(1, min(4, largest + 1)), *range(4, largest + 1, 4), largest])


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
