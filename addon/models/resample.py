"""Models in other light and view directions than those that were measured.

The model stands in for the samples, and its subtensors of a direction are interpolated by a
thin-plate spline in the reduced space, where that is linear (K-CTA, Section 6.3.2). Rows of a mode
that is not clustered are the spline of its columns. For a clustered mode each direction gets the K
clusters, and the rows in them, that are nearest to the interpolated subtensor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import nacre_native
import numpy as np
from numpy.typing import NDArray

from .clustered_tucker import ClusteredTucker
from .interpolation import thin_plate_weights
from .subspaces import subspace_gram

Angular = Literal["light", "view"]

NEIGHBOURS = 3
"""Measured directions nearest to a new one whose clusters compete with those of the search."""

SAME = 1e-6
"""Directions no farther apart than this are one."""


@dataclass(frozen=True)
class Rows:
    """A mode's rows at n directions, float64.

    basis    (owners, rows, K, R) as in a model; the light mode has a row for each colour
    members  (n, K) uint32, ascending; None where the mode is not clustered
    """

    basis: NDArray[np.float64]
    members: NDArray[np.uint32] | None


def resample(
    model: ClusteredTucker,
    lights: NDArray[np.floating] | None = None,
    views: NDArray[np.floating] | None = None,
) -> ClusteredTucker:
    """The model at unit directions lights (n, 3) and views (m, 3), as sparse as it was.

    None keeps a mode as it is. Measured directions keep their rows and clusters; ones lower than
    the lowest measured take its elevation. Of low lights that leaves the cosine out, with which
    values fade to the horizon (interpolation.horizon_fade): a model of logarithms cannot hold it.
    """
    bases, members, dataset = dict(model.bases), dict(model.members), dict(model.dataset)
    wanted: dict[Angular, NDArray[np.floating] | None] = {"light": lights, "view": views}
    for mode, directions in wanted.items():
        if directions is None:
            continue
        rows = resample_mode(model, mode, np.asarray(directions, float))
        bases[mode] = rows.basis.astype(np.float32)
        if rows.members is not None:
            members[mode] = rows.members
        dataset[mode] = np.asarray(directions).tolist()
    return replace(model, bases=bases, members=members, dataset=dataset)


def resample_mode(model: ClusteredTucker, mode: Angular, directions: NDArray[np.floating]) -> Rows:
    """The light or view rows at unit directions (n, 3); each row depends on its direction alone."""
    measured = np.asarray(model.dataset[mode], float)
    weights = thin_plate_weights(measured, directions)
    nearest = np.argsort(-(directions @ measured.T), axis=1)[:, :NEIGHBOURS]
    same = np.linalg.norm(directions - measured[nearest[:, 0]], axis=1) < SAME
    weights[same] = np.eye(len(measured))[nearest[same, 0]]
    if mode in model.clusters:
        return _mix_clusters(model, mode, weights, nearest, same)
    return Rows(_mix_rows(model.bases[mode], weights), None)


def _mix_rows(basis: NDArray[np.float32], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weighted sums of the rows of a basis (owners, I, 1, R), the rows of one item each."""
    owners, rows, mixtures, rank = basis.shape
    items = basis.reshape(owners, weights.shape[1], -1)
    return (weights @ items).reshape(owners, -1, mixtures, rank)


def _mix_clusters(
    model: ClusteredTucker,
    mode: Angular,
    weights: NDArray[np.float64],
    nearest: NDArray[np.intp],
    same: NDArray[np.bool_],
) -> Rows:
    """The clusters and rows nearest to weighted sums (n, I) of a clustered mode's subtensors.

    The clusters of the `nearest` (n, any) items compete with those of the papers' searches; where a
    direction is the `same` (n,) as its nearest item, that item's rows are kept.
    """
    members, basis = model.members[mode], model.bases[mode].astype(float)
    owners, count, mixtures, rank = basis.shape
    tied = count // len(members)  # colour rows share their light's clusters
    items = basis.reshape(owners, len(members), tied, mixtures, rank).transpose(1, 2, 3, 0, 4)
    items = items.reshape(len(members), tied, mixtures, -1)
    gram = subspace_gram(model, mode)
    # How each item projects on every cluster: the sum over k of u_k gram[c_k, c].
    projections = np.einsum("itks,ikcsr->itcr", items, gram[members], optimize=True)
    wanted = np.tensordot(weights, projections, (1, 0))
    search = "greedy" if mixtures > 2 else "optimal"
    found, rows = nacre_native.search_clusters(
        wanted.reshape(-1, *wanted.shape[2:]),
        gram,
        mixtures,
        candidates=members[nearest],
        search="kcta" if len(model.clusters) == 1 else search,
        tied=tied,
    )
    rows = rows.reshape(len(weights), tied, mixtures, owners, rank)
    found[same] = members[nearest[same, 0]]
    rows[same] = items[nearest[same, 0]].reshape(-1, tied, mixtures, owners, rank)
    return Rows(rows.transpose(3, 0, 1, 2, 4).reshape(owners, -1, mixtures, rank), found)
