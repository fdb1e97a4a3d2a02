"""A dataset in the coordinates of a generous N-SVD: small, and a fit to it is one to the dataset.

Modes that are not clustered are projected on orthonormal bases. Within their span distances stay as
they are (K-CTA, Eq. 23, does so with its global modes); what lies outside it adds a known squared
error to every fit.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path

import nacre_native
import numpy as np
from numpy.typing import NDArray

from ..datasets.dataset import Dataset
from ..errors import Cancelled, NacreError
from .clustered_tucker import MODES, ClusteredTucker, modes_of
from .fit import describe, mode_sizes
from .steps import Progress

BYTES_A_NUMBER = 32
"""Of a reduced dataset: what it takes together with a fit to it."""

_NUMBERS = 2**27  # that a first reduced dataset may have
_LIGHTS = 64  # ranks of its light mode; enough up to about 20 dB
_LOST = 0.1  # what the reduction may add to a fit's squared error, as a share of it


@dataclass(frozen=True)
class Reduced:
    """A dataset with projected samples, and the way back.

    dataset       its samples are float32 of the same axes, or (R_light, ..., 1) where the light
                  mode of a BTF, colour folded in, is projected
    projected     the modes that are
    core          of the N-SVD, (R of each mode)
    bases         of the N-SVD, (I, R) for each mode, orthonormal columns by falling energy
    squared_norm  of the dataset's samples, sum A^2
    lost          sum of the squared distances from the samples to the projected ones
    """

    dataset: Dataset
    projected: frozenset[str]
    core: NDArray[np.float32]
    bases: Mapping[str, NDArray[np.float32]]
    squared_norm: float
    lost: float

    @property
    def ranks(self) -> dict[str, int]:
        """The N-SVD's."""
        return {mode: basis.shape[1] for mode, basis in self.bases.items()}

    @property
    def nsvd(self) -> ClusteredTucker:
        """The N-SVD itself, as a model of the dataset."""
        bases = {mode: basis[None, :, None] for mode, basis in self.bases.items()}
        return ClusteredTucker(
            self.core[None], bases, {}, {}, describe(self.dataset), kind=self.dataset.kind
        )

    def restore(self, model: ClusteredTucker) -> ClusteredTucker:
        """A model that was fitted to the projected samples, as one of the dataset.

        The relative errors become the dataset's, too.
        """
        bases = {
            mode: np.einsum("ij,ojkr->oikr", self.bases[mode], basis)
            if mode in self.projected
            else basis
            for mode, basis in model.bases.items()
        }
        if self.squared_norm > 0.0:
            lost = self.lost / self.squared_norm
            errors = [error * (1.0 - lost) + lost for error in model.fit["errors"]]
            model = replace(model, fit={**model.fit, "errors": errors})
        return replace(model, bases=bases)


def reduce_dataset(
    dataset: Dataset,
    ranks: Mapping[str, int],
    clustered: Collection[str],
    *,
    scratch: Path,
    threads: int = 0,
    memory: int = 0,
    progress: Progress | None = None,
) -> Reduced:
    """Project a dataset on an N-SVD of some ranks; clustered modes have as many as they have rows.

    `memory` bounds the N-SVD, which puts what does not fit into the folder `scratch`. Raises
    NacreError for samples that cannot be fitted, Cancelled on request.
    """
    modes = modes_of(dataset.kind)
    # To the compiled helper, occlusion is a BTF of one light.
    samples = dataset.samples if "light" in modes else dataset.samples[None, ..., None]
    try:
        # One iteration: these bases are only a start, and more would gain little at such ranks.
        found = nacre_native.fit_nsvd(
            samples,
            tuple(ranks.get(mode, 1) for mode in MODES),
            iterations=1,
            threads=threads,
            memory=memory,
            scratch=str(scratch),
            progress=progress,
        )
    except nacre_native.Cancelled as error:
        raise Cancelled from error
    except (ValueError, MemoryError, OSError) as error:
        raise NacreError(f"{dataset.path.name}: {error}") from error
    core = found["core"][0]
    bases = {mode: basis[0, :, 0] for mode, basis in zip(MODES, found["basis"], strict=True)}
    if "light" not in modes:
        core = core[0] * bases.pop("light").item()  # 1 or -1
    samples = core
    for axis, mode in enumerate(modes):
        if mode in clustered:
            samples = np.moveaxis(np.tensordot(bases[mode], samples, (1, axis)), 0, axis)
    if "light" in modes:  # its rows are channels * light + channel
        channels = dataset.sizes["channel"] if "light" in clustered else 1
        samples = np.moveaxis(samples.reshape(-1, channels, *samples.shape[1:]), 1, -1)
    return Reduced(
        dataset=replace(dataset, samples=np.ascontiguousarray(samples)),
        projected=frozenset(modes) - frozenset(clustered),
        core=core,
        bases=bases,
        squared_norm=float(found["squared_norm"]),
        lost=float(found["errors"][-1] * found["squared_norm"]),
    )


def first_ranks(dataset: Dataset, clustered: Collection[str], memory: int = 0) -> dict[str, int]:
    """Ranks to begin with: all rows of clustered modes, as many of the others as memory has room
    for, and of the light mode's, which are three times the lights, few of them."""
    room = min(_NUMBERS, memory // BYTES_A_NUMBER) if memory else _NUMBERS
    ranks = mode_sizes(dataset)
    if "light" in ranks and "light" not in clustered:
        ranks["light"] = min(ranks["light"], _LIGHTS)
    spatial = ("y", "x")
    fixed = prod(rank for mode, rank in ranks.items() if mode not in spatial)
    excess = (fixed * prod(ranks[mode] for mode in spatial) / room) ** 0.5
    for mode in spatial:
        ranks[mode] = max(1, int(ranks[mode] / max(excess, 1.0)))
    return ranks


def larger_ranks(reduced: Reduced, chosen: Mapping[str, int], error: float) -> dict[str, int]:
    """Ranks at which a reduced dataset serves fits of some ranks and squared error better.

    The same ranks as it has where it is good enough.
    """
    rows = {mode: basis.shape[0] for mode, basis in reduced.bases.items()}
    ranks = reduced.ranks
    modes = [*ranks]
    unfinished = [mode for mode in modes if ranks[mode] < rows[mode]]
    short = {mode for mode in unfinished if chosen.get(mode) == ranks[mode]}
    if unfinished and reduced.lost > _LOST * error:

        def missing(mode: str) -> float:  # as if what is missing were like the last that is there
            last = np.take(reduced.core, -1, axis=modes.index(mode))
            return float(np.vdot(last, last)) * (rows[mode] - ranks[mode])

        short.add(max(unfinished, key=missing))
    return {
        mode: min(2 * rank, rows[mode]) if mode in short else rank for mode, rank in ranks.items()
    }
