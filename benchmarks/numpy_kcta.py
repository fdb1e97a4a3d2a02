"""K-CTA in straightforward numpy, to be compared with the compiled fit: whole arrays, matrix
products, float32 (double for the small Gram matrices).

Tsai and Shih 2012: Algorithm 1, with the clustering stage of Section 4.2 (Theorems 1, 3 and 4), the
update stage of Section 4.3 and the practice of Section 5 (k-means in the space of directions, one
global light basis, empty clusters split, the last result again where the error rises). As a program
it fits the wool sample.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _machine
from ._materials import wool
from ._tensors import (
    Array,
    in_batches,
    inverse_factor,
    kmeans,
    leading_basis,
    split_empty,
    squared_norm,
    tensor_of,
)

FIRST_SWEEPS = 3
ITERATIONS = 8  # of the program


@dataclass
class Cluster:
    """core (R_view, R_light, R_y, R_x), bases (I, R) of y and x, and its members' views."""

    members: NDArray[np.intp]
    y: Array | None = None
    x: Array | None = None
    core: Array | None = None


class Fit:
    """The state of a fit of views (view, R_light, y, x), reduced by the global basis (Eq. 23)."""

    def __init__(
        self, views: Array, energy: float, ranks: tuple[int, int, int], labels: NDArray[np.intp]
    ) -> None:
        self.views, self.energy, self.ranks = views, energy, ranks
        self.flat = views.reshape(len(views), -1)
        self.item_energy = np.array([np.float64(row @ row) for row in self.flat])
        self.lost = max(0.0, energy - self.item_energy.sum())
        count = int(labels.max()) + 1
        self.clusters = [Cluster(np.flatnonzero(labels == c)) for c in range(count)]
        # U_m of every cluster, and Z_c x_n U_n,c over the other modes.
        self.mixing = np.zeros((len(views), count, ranks[0]), np.float32)
        self.expanded = np.zeros((count, ranks[0], self.flat.shape[1]), np.float32)
        for c in range(count):
            self.update(c, FIRST_SWEEPS)

    def project(self) -> float:
        """Project all views on all clusters (Eqs. 17 and 18); returns the relative error."""
        basis = self.expanded.reshape(-1, self.flat.shape[1])
        width = len(basis)
        self.projections = (self.flat @ basis.T).astype(np.float64)
        self.gram = (basis @ basis.T).astype(np.float64)
        mixing = self.mixing.reshape(-1, width).astype(np.float64)
        approximated = ((mixing @ self.gram - 2 * self.projections) * mixing).sum(1)
        self.item_errors = np.maximum(0, self.item_energy + approximated)
        return float((self.lost + self.item_errors.sum()) / self.energy)

    def search(self, mixtures: int) -> None:
        """The clustering stage: Eqs. 9 to 15, all in the reduced space."""
        items, count, rank = self.mixing.shape
        gram = self.gram.reshape(count, rank, count, rank)
        dual = inverse_factor(np.stack([gram[c, :, c] for c in range(count)]))  # Eq. 7
        self.mixing[:] = 0
        for i in range(items):
            projections = self.projections[i].reshape(count, rank)
            residual, chosen = projections, list[int]()
            for _ in range(mixtures):
                kept = np.square(residual[:, None] @ dual).sum((1, 2))
                kept[chosen] = -1
                chosen = sorted([*chosen, int(kept.argmax())])
                factor = inverse_factor(
                    gram[chosen][:, :, chosen].reshape(len(chosen) * rank, len(chosen) * rank)
                )
                found = factor @ (factor.T @ projections[chosen].ravel())
                residual = projections - np.tensordot(
                    found.reshape(-1, rank), gram[chosen], ((0, 1), (0, 1))
                )
            self.mixing[i, chosen] = found.reshape(-1, rank)
        members = [np.flatnonzero(self.mixing[:, c].any(1)) for c in range(count)]
        for empty, worst in split_empty(members, self.item_errors):
            moved = members[empty]
            self.mixing[moved, empty] = self.mixing[moved, worst]
            self.mixing[moved, worst] = 0
            self.expanded[empty] = self.expanded[worst]
            self.clusters[empty].y = self.clusters[worst].y
            self.clusters[empty].x = self.clusters[worst].x
        for cluster, items_of_it in zip(self.clusters, members, strict=True):
            cluster.members = items_of_it

    def update_all(self) -> None:
        """The update stage, cluster by cluster."""
        mixed = self.mixing.any(2)
        for c in in_batches(len(self.clusters), lambda a, b: bool(mixed[:, [a, b]].all(1).any())):
            self.update(c)

    def update(self, c: int, sweeps: int = 1) -> None:
        """The update stage for one cluster: decompose what the others leave over (Eqs. 20 to 22).

        Alternating least squares from the last bases, or from a sequentially truncated HOSVD.
        """
        cluster = self.clusters[c]
        rank, rank_y, rank_x = self.ranks
        members = cluster.members
        others = self.mixing[members]
        others[:, c] = 0
        residual = self.flat[members] - others.reshape(len(members), -1) @ self.expanded.reshape(
            -1, self.flat.shape[1]
        )
        residual = residual.reshape(len(members), *self.views.shape[1:])
        if cluster.y is None or cluster.x is None:
            mixing = leading_basis(gram(residual, 0), rank)
            combined = np.tensordot(mixing, residual, (0, 0))
            cluster.y = leading_basis(gram(combined, 2), rank_y)
            cluster.x = leading_basis(gram(cluster.y.T @ combined, 3), rank_x)
        for _ in range(sweeps):
            mixing = leading_basis(gram(cluster.y.T @ (residual @ cluster.x), 0), rank)
            combined = np.tensordot(mixing, residual, (0, 0))
            cluster.y = leading_basis(gram(combined @ cluster.x, 2), rank_y)
            cluster.x = leading_basis(gram(cluster.y.T @ combined, 3), rank_x)
        cluster.core = cluster.y.T @ combined @ cluster.x
        self.mixing[:, c] = 0
        self.mixing[members, c] = mixing
        self.expanded[c] = (cluster.y @ (cluster.core @ cluster.x.T)).reshape(rank, -1)


def gram(tensor: NDArray[Any], mode: int) -> NDArray[Any]:
    """uf_mode(A) uf_mode(A)^T."""
    unfolded = np.moveaxis(tensor, mode, 0).reshape(tensor.shape[mode], -1)
    return unfolded @ unfolded.T


def fit(
    samples: NDArray[Any],
    ranks: tuple[int, int, int, int],
    clusters: int,
    mixtures: int,
    iterations: int,
    directions: NDArray[Any] | None = None,
    labels: NDArray[np.intp] | None = None,
) -> tuple[Fit, Array, list[float]]:
    """K-CTA of samples (light, view, y, x, channel) with clustered views and a global light basis.

    ranks are of (light rows, view, y, x). The first cluster of each view comes from k-means of
    `directions` (view, 3), or is given in `labels`. Returns the fit, the light basis and the
    relative squared errors of the first guess and after each iteration, until one would rise.
    """
    if labels is None:
        assert directions is not None
        labels = kmeans(directions, clusters)
    tensor = tensor_of(samples)
    energy = squared_norm(tensor)
    light = leading_basis(gram(tensor, 0), ranks[0])
    views = np.ascontiguousarray(np.tensordot(light, tensor, (0, 0)).transpose(1, 0, 2, 3))
    del tensor
    state = Fit(views, energy, ranks[1:], labels)
    errors = [state.project()]
    for _ in range(iterations):
        last = [replace(cluster) for cluster in state.clusters], state.mixing.copy()
        state.search(mixtures)
        state.update_all()
        error = state.project()
        if error > errors[-1]:  # Section 5.3: the last result again
            state.clusters, state.mixing = last
            break
        errors.append(error)
    return state, light, errors


def main() -> None:
    _machine.report()
    with tempfile.TemporaryDirectory() as folder:
        dataset = wool(folder)
        seconds, errors = [], []
        for iterations in (0, ITERATIONS):
            started = time.perf_counter()
            _, _, errors = fit(dataset.samples, (20, 4, 32, 32), 7, 3, iterations, dataset.view)
            seconds.append(time.perf_counter() - started)
    print(
        f"K-CTA in numpy, wool, ranks 20x4x32x32, C 7, K 3: start {seconds[0]:.2f} s, "
        f"{(seconds[1] - seconds[0]) / ITERATIONS:.2f} s an iteration; SNR by iteration "
        + " ".join(f"{-10 * np.log10(error):.2f}" for error in errors)
    )


if __name__ == "__main__":
    main()
