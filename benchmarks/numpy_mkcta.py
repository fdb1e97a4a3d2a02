"""MK-CTA in straightforward numpy, to be compared with the compiled fit: whole arrays, matrix
products, float32 (double for the small Gram matrices).

Tsai 2015: Algorithms 1 to 3. Light and view are clustered, y and x have global bases, found first
by N-SVD; what is clustered is the tensor projected on them. The colour rows of one light share
their clusters: the objective of a light is the sum over its rows. Everything that the searches need
comes from Eqs. 15 to 17, and the blocks of Eq. 17 whose clusters share no item are skipped.
As a program it fits the wool sample.
"""

from __future__ import annotations

import tempfile
import time
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _machine
from ._materials import wool
from ._tensors import (
    DEPENDENT,
    Array,
    inverse_factor,
    kmeans,
    leading_basis,
    split_empty,
    squared_norm,
    tensor_of,
)

FIRST_ITERATIONS = 4
FIRST_GAIN = 0.02
"""Section 4.2 begins with one mixture cluster a mode "for several iterations": four at most, and no
more once the error falls by less than this part."""

FIRST_SWEEPS = 3
"""Of the decomposition of each first cluster."""

ITERATIONS = 8
"""Of the program."""


def spatial_bases(tensor: Array, rank_y: int, rank_x: int) -> tuple[Array, Array]:
    """Global bases of y and x: sequentially truncated HOSVD and one sweep of least squares."""
    columns = tensor.reshape(-1, tensor.shape[-1])
    x = leading_basis(columns.T @ columns, rank_x)
    y = leading_basis(sum(_gram_y(rows @ x) for rows in tensor), rank_y)
    total = np.zeros((tensor.shape[-1],) * 2, np.float32)
    for rows in tensor:
        projected = (y.T @ rows).reshape(-1, rows.shape[-1])
        total += projected.T @ projected
    return y, leading_basis(total, rank_x)


def _gram_y(rows: Array) -> Array:
    return np.tensordot(rows, rows, ((0, 2), (0, 2)))


class Fit:
    """The state of a fit of a tensor (light rows, view, P), P the projections on y and x.

    bases[n]    (C_light, C_view, I_n, R_n), n = 0 light, 1 view; rows of non-members are zero
    core        (C_light, C_view, R_light, R_view, P)
    members[n]  (C_n, I_n) bool; all colour rows of a light alike
    tied[n]     rows that share their clusters: the colours of a light, or 1
    """

    def __init__(
        self,
        tensor: Array,
        energy: float,
        ranks: tuple[int, int],
        labels: tuple[NDArray[np.intp], NDArray[np.intp]],
        channels: int,
    ) -> None:
        self.tensor, self.energy, self.ranks = tensor, energy, ranks
        self.tied = (channels, 1)
        self.item_energy = [
            np.array([squared_norm(tensor[i : i + 1]) for i in range(tensor.shape[0])]),
            np.array([squared_norm(tensor[:, i]) for i in range(tensor.shape[1])]),
        ]
        self.lost = max(0.0, energy - self.item_energy[0].sum())
        counts = tuple(int(found.max()) + 1 for found in labels)
        self.members = [
            np.repeat(np.arange(counts[n])[:, None] == labels[n], self.tied[n], axis=1)
            for n in range(2)
        ]
        self.bases = [np.zeros((*counts, tensor.shape[n], ranks[n]), np.float32) for n in range(2)]
        self.core = np.zeros((*counts, *ranks, tensor.shape[2]), np.float32)
        self.left = tensor.copy()  # what no cluster explains
        self.decompose(FIRST_SWEEPS)

    @property
    def counts(self) -> tuple[int, int]:
        return self.core.shape[0], self.core.shape[1]

    def error(self) -> float:
        """Relative squared error."""
        return float((self.lost + squared_norm(self.left)) / self.energy)

    def expanded(self, n: int) -> list[Array]:
        """Z_c times the other mode's bases (Eq. 7), for each cluster of the other mode an array
        (C_n, R_n, its members, P)."""
        other = 1 - n
        found = []
        for o in range(self.counts[other]):
            items = np.flatnonzero(self.members[other][o])
            if n == 0:
                core, basis = self.core[:, o], self.bases[1][:, o, items]
            else:
                core, basis = self.core[o].swapaxes(1, 2), self.bases[0][o][:, items]
            found.append(basis[:, None] @ core)
        return found

    def projections(self, n: int, expanded: list[Array]) -> NDArray[np.float64]:
        """Eq. 16 for every item of mode n: (I_n, C_n, unknowns of a cluster)."""
        parts = []
        for member, basis in zip(self.members[1 - n], expanded, strict=True):
            flat = basis.reshape(basis.shape[0] * basis.shape[1], *basis.shape[2:])
            if n == 0:
                rows = self.tensor[:, member].reshape(len(self.tensor), -1)
                part = rows @ flat.reshape(len(flat), -1).T
            else:
                items = enumerate(np.flatnonzero(member))
                part = sum(self.tensor[i] @ flat[:, k].T for k, i in items)
            parts.append(part.reshape(-1, *basis.shape[:2]))
        stacked = np.stack(parts, axis=2)  # (I_n, C_n, C_other, R_n)
        return stacked.reshape(*stacked.shape[:2], -1).astype(np.float64)

    def gram(self, n: int, expanded: list[Array]) -> NDArray[np.float64]:
        """Eq. 17: (C_n, unknowns, C_n, unknowns), zero where two clusters share no item."""
        member = self.members[1 - n]
        count, rank = self.counts[n], self.ranks[n]
        total = np.zeros((count, len(member), rank, count, len(member), rank))
        for a, b in combinations(range(len(member)), 2):
            shared = member[a] & member[b]
            if not shared.any():
                continue
            rows, columns = (
                expanded[c][:, :, shared[member[c]]].reshape(count * rank, -1) for c in (a, b)
            )
            block = (rows @ columns.T).reshape(count, rank, count, rank)
            total[:, a, :, :, b] = block
            total[:, b, :, :, a] = block.transpose(2, 3, 0, 1)
        for a in range(len(member)):
            rows = expanded[a].reshape(count * rank, -1)
            total[:, a, :, :, a] = (rows @ rows.T).reshape(count, rank, count, rank)
        unknowns = len(member) * rank
        return total.reshape(count, unknowns, count, unknowns)

    def cluster(self, n: int, mixtures: int) -> None:
        """The clustering stage of one mode: Algorithm 2 where mixtures < 3, else Algorithm 3."""
        expanded = self.expanded(n)
        projections, gram = self.projections(n, expanded), self.gram(n, expanded)
        del expanded
        items, count, unknowns = projections.shape
        groups = items // self.tied[n]
        factors: dict[tuple[int, ...], NDArray[Any]] = {}

        def factor(clusters: tuple[int, ...]) -> NDArray[Any]:
            if clusters not in factors:
                size = len(clusters) * unknowns
                block = gram[list(clusters)][:, :, list(clusters)]
                factors[clusters] = inverse_factor(block.reshape(size, size))
            return factors[clusters]

        def explained(clusters: tuple[int, ...], rows: NDArray[Any] | slice) -> NDArray[Any]:
            """Eq. 15 for each item group: the energy that these clusters explain."""
            chosen = projections[rows][:, list(clusters)].reshape(-1, len(clusters) * unknowns)
            reduced = np.square(chosen @ factor(clusters)).sum(1)
            return reduced.reshape(-1, self.tied[n]).sum(1)

        if mixtures < 3:
            sets = list(combinations(range(count), mixtures))
            best = np.argmax([explained(one, slice(None)) for one in sets], axis=0)
            chosen = [sets[s] for s in best]
        else:
            chosen = [()] * groups
            for _ in range(mixtures):
                for known in sorted(set(chosen)):
                    same = np.array([g for g in range(groups) if chosen[g] == known])
                    rows = (same[:, None] * self.tied[n] + np.arange(self.tied[n])).ravel()
                    more = [tuple(sorted((*known, c))) for c in range(count) if c not in known]
                    best = np.argmax([explained(one, rows) for one in more], axis=0)
                    for g, s in zip(same, best, strict=True):
                        chosen[g] = more[s]

        basis = np.zeros((items, count, unknowns), np.float32)
        left = np.zeros(items)
        for group, clusters in enumerate(chosen):
            known = list(clusters)
            for i in range(group * self.tied[n], (group + 1) * self.tied[n]):
                values = projections[i, known].ravel()
                reduced = values @ factor(clusters)
                basis[i, known] = (factor(clusters) @ reduced).reshape(len(known), unknowns)
                left[i] = max(0.0, self.item_energy[n][i] - reduced @ reduced)
        self.split_empty(n, basis, chosen, left)
        split = basis.reshape(items, count, self.counts[1 - n], self.ranks[n])
        self.bases[n] = np.ascontiguousarray(
            split.transpose(1, 2, 0, 3) if n == 0 else split.transpose(2, 1, 0, 3)
        )
        self.orthonormalise(n)

    def split_empty(
        self, n: int, basis: Array, chosen: list[tuple[int, ...]], errors: NDArray[Any]
    ) -> None:
        """Set the members of mode n; an empty cluster takes half of another's and its core."""
        count, tied = basis.shape[1], self.tied[n]
        members = [
            np.array([g for g, clusters in enumerate(chosen) if c in clusters], np.intp)
            for c in range(count)
        ]
        for empty, worst in split_empty(members, errors.reshape(-1, tied).sum(1)):
            rows = (members[empty][:, None] * tied + np.arange(tied)).ravel()
            basis[rows, empty] = basis[rows, worst]
            basis[rows, worst] = 0
            where, source = (np.s_[:, c] if n else np.s_[c] for c in (empty, worst))
            self.core[where] = self.core[source]
            self.bases[1 - n][where] = self.bases[1 - n][source]
        self.members[n][:] = False
        for c, groups in enumerate(members):
            self.members[n][c, (groups[:, None] * tied + np.arange(tied)).ravel()] = True

    def orthonormalise(self, n: int) -> None:
        """Section 3.5.3: U = U' W by singular value decomposition, and W goes into the core."""
        u, s, v = np.linalg.svd(self.bases[n].astype(np.float64), full_matrices=False)
        kept = s > DEPENDENT * s[..., :1]
        # Rounding leaves traces in the rows of non-members.
        member = np.expand_dims(self.members[n], 1 - n)[..., None]
        self.bases[n] = np.where(member, u * kept[..., None, :], 0).astype(np.float32)
        weight = ((s * kept)[..., None] * v).astype(np.float32)
        if n == 0:
            shape = self.core.shape
            self.core = (weight @ self.core.reshape(*shape[:3], -1)).reshape(shape)
        else:
            self.core = weight[:, :, None] @ self.core

    def approximate(self, a: int, b: int) -> Array:
        """The part of cluster (a, b), for its members only."""
        light = self.bases[0][a, b, self.members[0][a]]
        view = self.bases[1][a, b, self.members[1][b]]
        core = view @ self.core[a, b]  # (R_light, views, P)
        return np.tensordot(light, core, (1, 0))

    def refresh(self) -> None:
        """The residual of all clusters, anew."""
        np.copyto(self.left, self.tensor)
        for a, b in np.ndindex(self.counts):
            if self.core[a, b].any():
                place = np.ix_(self.members[0][a], self.members[1][b])
                self.left[place] -= self.approximate(a, b)

    def decompose(self, sweeps: int = 1) -> None:
        """The decomposition stage: each cluster in turn, on what the others leave over."""
        for a, b in np.ndindex(self.counts):
            self.decompose_one(a, b, sweeps)

    def decompose_one(self, a: int, b: int, sweeps: int = 1) -> None:
        """Decompose the residual of one cluster (Eqs. 12 to 14) by alternating least squares."""
        place = np.ix_(self.members[0][a], self.members[1][b])
        residual = self.left[place]
        residual += self.approximate(a, b)
        view = self.bases[1][a, b, self.members[1][b]]
        if not view.any():
            view = leading_basis(_gram(residual, 1), self.ranks[1])
        for _ in range(sweeps):
            light = leading_basis(_gram(view.T @ residual, 0), self.ranks[0])
            reduced = np.tensordot(light, residual, (0, 0))
            view = leading_basis(_gram(reduced, 1), self.ranks[1])
        self.bases[0][a, b, self.members[0][a]] = light
        self.bases[1][a, b, self.members[1][b]] = view
        self.core[a, b] = view.T @ reduced
        self.left[place] = residual - self.approximate(a, b)

    def iterate(self, mixtures: tuple[int, int]) -> None:
        """One iteration of Algorithm 1."""
        for n in range(2):
            self.cluster(n, mixtures[n])
        self.refresh()
        self.decompose()

    def copy(self) -> tuple[list[NDArray[np.bool_]], list[Array], Array]:
        """What a result consists of."""
        return [m.copy() for m in self.members], [b.copy() for b in self.bases], self.core.copy()

    def restore(self, result: tuple[list[NDArray[np.bool_]], list[Array], Array]) -> None:
        """Take back an earlier result."""
        self.members, self.bases, self.core = result
        self.refresh()


def _gram(tensor: Array, mode: int) -> Array:
    unfolded = np.moveaxis(tensor, mode, 0).reshape(tensor.shape[mode], -1)
    return unfolded @ unfolded.T


def fit(
    samples: NDArray[Any],
    ranks: tuple[int, int, int, int],
    clusters: tuple[int, int],
    mixtures: tuple[int, int],
    iterations: int,
    directions: tuple[NDArray[Any], NDArray[Any]] | None = None,
    labels: tuple[NDArray[np.intp], NDArray[np.intp]] | None = None,
) -> tuple[Fit, tuple[Array, Array], list[float]]:
    """MK-CTA of samples (light, view, y, x, channel) with clustered lights and views.

    ranks are of (light rows, view, y, x), clusters and mixtures of (light, view). The first
    clusters come from k-means of `directions` (light, view), or are given in `labels`. The first
    iterations have one mixture cluster. Returns the fit, the bases of y and x and the relative
    squared errors of the first guess and after each iteration, until one would rise.
    """
    if labels is None:
        assert directions is not None
        labels = (kmeans(directions[0], clusters[0]), kmeans(directions[1], clusters[1]))
    tensor = tensor_of(samples)
    energy = squared_norm(tensor)
    y, x = spatial_bases(tensor, *ranks[2:])
    reduced = np.stack([y.T @ (rows @ x) for rows in tensor])
    del tensor
    reduced = reduced.reshape(*reduced.shape[:2], -1)
    state = Fit(reduced, energy, ranks[:2], labels, samples.shape[-1])
    errors = [state.error()]
    first = True
    while len(errors) <= iterations:
        last = state.copy()
        state.iterate((1, 1) if first else mixtures)
        error = state.error()
        if error > errors[-1]:  # the last result again
            state.restore(last)
            if not first:
                break
            first = False
            continue
        errors.append(error)
        gain = errors[-2] - errors[-1]
        first = first and len(errors) <= FIRST_ITERATIONS and gain > FIRST_GAIN * error
    return state, (y, x), errors


def main() -> None:
    _machine.report()
    with tempfile.TemporaryDirectory() as folder:
        dataset = wool(folder)
        seconds, errors = [], []
        for iterations in (0, ITERATIONS):
            started = time.perf_counter()
            _, _, errors = fit(
                dataset.samples, (4, 4, 40, 40), (8, 10), (2, 2), iterations,
                (dataset.light, dataset.view),
            )  # fmt: skip
            seconds.append(time.perf_counter() - started)
    print(
        f"MK-CTA in numpy, wool, ranks 4x4x40x40, C 8x10, K 2x2: start {seconds[0]:.2f} s, "
        f"{(seconds[1] - seconds[0]) / ITERATIONS:.2f} s an iteration; SNR by iteration "
        + " ".join(f"{-10 * np.log10(error):.2f}" for error in errors)
    )


if __name__ == "__main__":
    main()
