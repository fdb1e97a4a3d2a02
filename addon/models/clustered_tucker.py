"""Clustered Tucker: the one representation behind N-SVD, CTA, K-CTA and MK-CTA.

    A  ~  sum over cluster vectors c of  Z_c  x_1 U_1,c  x_2 U_2,c ... x_N U_N,c     (K-CTA, Eq. 8)

Colour folds into the light mode, whose rows are channels * light + channel: one core serves all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..datasets.dataset import KINDS
from .domain import to_linear


def modes_of(kind: str) -> tuple[str, ...]:
    """Tensor modes of a kind of dataset in axis order; colour is none."""
    return tuple(axis for axis in KINDS[kind] if axis != "channel")


MODES = modes_of("btf")
"""Tensor modes of a BTF."""

Part = slice | Sequence[int] | NDArray[np.intp]
"""Which indices of an axis."""


@dataclass(frozen=True)
class ClusteredTucker:
    """A BTF or occlusion as cluster core tensors and sparse bases.

    core      (clusters, R of each mode) float32, modes light, view, y, x of a BTF and view, y, x of
              occlusion; clusters of several clustered modes are flattened in axis order, last
              fastest.
    bases     for each mode (owners, I, K, R) float32. Owners are the combinations of the *other*
              clustered modes' clusters, or 1 when the basis is global. K is 1 unless the mode is
              clustered, and then basis[o, i, k] is the row that item i has in its k-th cluster.
    members   for each clustered mode (I, K) uint32, the clusters of each item; for the light mode
              one row a light, shared by its colour rows.
    clusters  for each clustered mode, its number of clusters.
    dataset   what the decoded samples are: light, view, channels, patch_size, periodic, source ...
              of a BTF; view, value, patch_size ... of occlusion.
    fit       how it was made: method, seed, iterations, relative squared errors, and the domain of
              the fitted colours (models.domain; linear where it is not said).
    kind      "btf" or "occlusion".
    """

    core: NDArray[np.float32]
    bases: Mapping[str, NDArray[np.float32]]
    members: Mapping[str, NDArray[np.uint32]]
    clusters: Mapping[str, int]
    dataset: Mapping[str, Any]
    fit: Mapping[str, Any] = field(default_factory=dict)
    kind: str = "btf"

    @property
    def modes(self) -> tuple[str, ...]:
        """Tensor modes in axis order."""
        return modes_of(self.kind)

    @property
    def ranks(self) -> dict[str, int]:
        """The reduced rank of each mode."""
        return dict(zip(self.modes, self.core.shape[1:], strict=True))

    @property
    def mixtures(self) -> dict[str, int]:
        """The number of mixture clusters of each clustered mode."""
        return {mode: members.shape[1] for mode, members in self.members.items()}

    @property
    def domain(self) -> str:
        """What the core and the bases are a model of: "linear" or "log" colours."""
        return str(self.fit.get("domain", "linear"))

    @property
    def channels(self) -> int:
        """Colour channels of a BTF, folded into the light mode."""
        return len(self.dataset["channels"])

    @property
    def shape(self) -> tuple[int, ...]:
        """The decoded samples' shape: (light, view, y, x, channel) or (view, y, x)."""
        sizes = tuple(self.bases[mode].shape[1] for mode in self.modes)
        if self.kind != "btf":
            return sizes
        return sizes[0] // self.channels, *sizes[1:], self.channels

    def decode(
        self,
        light: Part = slice(None),
        view: Part = slice(None),
        y: Part = slice(None),
        x: Part = slice(None),
    ) -> NDArray[np.float32]:
        """Samples of one block, float32; unclamped values.

        (light, view, y, x, channel), linear, of a BTF. Of occlusion (view, y, x), masks or signed
        distances as fitted; it has no lights to choose from.
        """
        parts = {"light": light, "view": view, "y": y, "x": x}
        rows = {
            mode: np.arange(size)[parts[mode]]
            for mode, size in zip(self.modes, self.shape, strict=False)
        }
        if self.kind != "btf":
            return self._decode_rows(rows)
        lights, channels = rows["light"], self.channels
        rows["light"] = (channels * lights[:, None] + np.arange(channels)).ravel()
        block = self._decode_rows(rows)
        lit = block.reshape(len(lights), channels, *block.shape[1:])
        values = np.ascontiguousarray(np.moveaxis(lit, 1, -1))
        return to_linear(values) if self.domain == "log" else values

    def _decode_rows(self, rows: Mapping[str, NDArray[np.intp]]) -> NDArray[np.float32]:
        """The approximated tensor at some rows of each mode."""
        block = np.zeros([len(rows[mode]) for mode in self.modes], np.float32)
        # Modes after the last clustered one are whole in every cluster: adding slices is faster.
        scattered = max((self.modes.index(mode) + 1 for mode in self.clusters), default=0)
        for cluster in range(len(self.core)):
            members = [self.member_rows(mode, cluster, rows[mode]) for mode in self.modes]
            places = [place for place, _ in members]
            block[np.ix_(*places[:scattered])] += expand(
                self.core[cluster], [factor for _, factor in members]
            )
        return block

    def core_of(self, mode: str) -> NDArray[np.intp]:
        """Which core each row of a clustered mode's basis goes with: (owners, I, K)."""
        basis, counts = self.bases[mode], list(self.clusters.values())
        others = [count for name, count in self.clusters.items() if name != mode]
        vectors = list(np.unravel_index(np.arange(len(basis)), others)) if others else []
        members = np.repeat(self.members[mode], basis.shape[1] // len(self.members[mode]), axis=0)
        parts = [vector[:, None, None] for vector in vectors]
        parts.insert(list(self.clusters).index(mode), members[None].astype(np.intp))
        return np.broadcast_to(
            np.ravel_multi_index(np.broadcast_arrays(*parts), counts), basis.shape[:3]
        )

    def member_rows(
        self, mode: str, cluster: int, rows: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
        """Where in `rows` the members of a cluster stand, and their basis rows (members, R)."""
        vector = self._cluster_vector(cluster)
        basis = self.bases[mode]
        owner = 0
        if len(basis) > 1:
            others = [name for name in self.clusters if name != mode]
            owner = int(
                np.ravel_multi_index(
                    [vector[name] for name in others], [self.clusters[name] for name in others]
                )
            )
        if mode not in self.members:
            return np.arange(len(rows)), basis[owner, rows, 0]
        tied = basis.shape[1] // len(self.members[mode])  # colour rows share their light's clusters
        places, slots = np.nonzero(self.members[mode][rows // tied] == vector[mode])
        return places, basis[owner, rows[places], slots]

    def _cluster_vector(self, cluster: int) -> dict[str, int]:
        """The cluster of each clustered mode that a core belongs to."""
        vector = []
        for count in reversed([*self.clusters.values()]):
            cluster, last = divmod(cluster, count)
            vector.append(last)
        return dict(zip(self.clusters, reversed(vector), strict=True))


def expand(
    core: NDArray[np.float32], factors: Sequence[NDArray[np.float32]]
) -> NDArray[np.float32]:
    """Mode products core x_1 F_1 x_2 F_2 ... (K-CTA, Eq. 3); factors are (I_n, R_n)."""
    # The mode that grows most goes last, so that the earlier products stay small.
    growth = [factor.shape[0] / factor.shape[1] for factor in factors]
    for mode in np.argsort(growth, kind="stable"):
        before, rank, after = core.shape[:mode], core.shape[mode], core.shape[mode + 1 :]
        if after:
            core = factors[mode] @ core.reshape(prod(before), rank, prod(after))
        else:  # one matrix product instead of one for each row
            core = core.reshape(prod(before), rank) @ factors[mode].T
        core = core.reshape(*before, len(factors[mode]), *after)
    return core
