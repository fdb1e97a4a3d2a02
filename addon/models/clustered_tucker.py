"""Clustered Tucker: the one representation behind N-SVD, CTA, K-CTA and MK-CTA.

    A  ~  sum over cluster vectors c of  Z_c  x_1 U_1,c  x_2 U_2,c ... x_N U_N,c        (K-CTA, Eq. 8)

Colour folds into the light mode: its rows are 3 * light + channel, so one core serves all channels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import prod

import numpy as np
from numpy.typing import NDArray

MODES = ("light", "view", "y", "x")
"""Tensor modes of a BTF in axis order."""


@dataclass(frozen=True)
class ClusteredTucker:
    """A BTF as cluster core tensors and sparse bases.

    core      (clusters, R_light, R_view, R_y, R_x) float32; clusters of several clustered modes are
              flattened in axis order, last fastest.
    bases     for each mode (owners, I, K, R) float32. Owners are the combinations of the *other*
              clustered modes' clusters, or 1 when the basis is global. K is 1 unless the mode is
              clustered, and then basis[o, i, k] is the row that item i has in its k-th cluster.
    members   for each clustered mode (I, K) uint32, the clusters of each item; for the light mode
              one row a light, shared by its colour rows.
    clusters  for each clustered mode, its number of clusters.
    dataset   what the decoded samples are: light, view, channels, patch_size, periodic, source ...
    fit       how it was made: method, seed, iterations, relative squared errors.
    """

    core: NDArray[np.float32]
    bases: Mapping[str, NDArray[np.float32]]
    members: Mapping[str, NDArray[np.uint32]]
    clusters: Mapping[str, int]
    dataset: Mapping[str, object]
    fit: Mapping[str, object] = field(default_factory=dict)

    @property
    def ranks(self) -> dict[str, int]:
        """The reduced rank of each mode."""
        return dict(zip(MODES, self.core.shape[1:], strict=True))

    @property
    def mixtures(self) -> dict[str, int]:
        """The number of mixture clusters of each clustered mode."""
        return {mode: members.shape[1] for mode, members in self.members.items()}

    @property
    def channels(self) -> int:
        """Colour channels, folded into the light mode."""
        return len(self.dataset["channels"])  # type: ignore[arg-type]

    @property
    def shape(self) -> tuple[int, int, int, int, int]:
        """The decoded samples' shape: (light, view, y, x, channel)."""
        rows, view, y, x = (self.bases[mode].shape[1] for mode in MODES)
        return rows // self.channels, view, y, x, self.channels

    def decode(
        self,
        light: slice | Sequence[int] = slice(None),
        view: slice | Sequence[int] = slice(None),
        y: slice | Sequence[int] = slice(None),
        x: slice | Sequence[int] = slice(None),
    ) -> NDArray[np.float32]:
        """Samples of one block, float32 (light, view, y, x, channel); unclamped linear values."""
        channels = self.channels
        lights = np.arange(self.shape[0])[light]
        rows = {
            "light": (channels * lights[:, None] + np.arange(channels)).ravel(),
            "view": np.arange(self.shape[1])[view],
            "y": np.arange(self.shape[2])[y],
            "x": np.arange(self.shape[3])[x],
        }
        block = np.zeros([len(rows[mode]) for mode in MODES], np.float32)
        for cluster in range(len(self.core)):
            places, factors = zip(
                *(self._member_rows(mode, cluster, rows[mode]) for mode in MODES), strict=True
            )
            if all(len(place) for place in places):
                block[np.ix_(*places)] += expand(self.core[cluster], factors)
        lit = block.reshape(len(lights), channels, *block.shape[1:])
        return np.ascontiguousarray(np.moveaxis(lit, 1, -1))

    def _member_rows(
        self, mode: str, cluster: int, rows: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
        """Where in `rows` the members of a cluster stand, and their basis rows (members, R)."""
        basis = self.bases[mode]
        vector = dict(
            zip(self.clusters, np.unravel_index(cluster, [*self.clusters.values()]), strict=True)
        ) if self.clusters else {}
        others = [name for name in self.clusters if name != mode]
        owner = 0
        if len(basis) > 1:
            owner = int(
                np.ravel_multi_index(
                    [vector[name] for name in others], [self.clusters[name] for name in others]
                )
            )
        if mode not in self.members:
            return np.arange(len(rows)), basis[owner, rows, 0]
        tied = basis.shape[1] // len(self.members[mode])  # colour rows share their light's clusters
        member = self.members[mode][rows // tied] == vector[mode]
        places, slots = np.nonzero(member)
        return places, basis[owner, rows[places], slots]


def expand(core: NDArray[np.float32], factors: Sequence[NDArray[np.float32]]) -> NDArray[np.float32]:
    """Mode products core x_1 F_1 x_2 F_2 ... (K-CTA, Eq. 3); factors are (I_n, R_n)."""
    # The mode that grows most goes last, so that the earlier products stay small.
    growth = [factor.shape[0] / factor.shape[1] for factor in factors]
    for mode in np.argsort(growth, kind="stable"):
        core = np.moveaxis(np.tensordot(factors[mode], core, (1, mode)), 0, mode)
    return core


def stored_values(model: ClusteredTucker) -> int:
    """Half floats and indices the model stores, the measure of the papers' size columns."""
    arrays = [model.core, *model.bases.values(), *model.members.values()]
    return sum(prod(array.shape) for array in arrays)
