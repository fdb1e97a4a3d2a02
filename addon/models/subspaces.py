"""The subspaces that a mode's clusters span: their scalar products, in the reduced space."""

from __future__ import annotations

from math import prod

import numpy as np
from numpy.typing import NDArray

from .clustered_tucker import ClusteredTucker


def subspace_gram(model: ClusteredTucker, mode: str) -> NDArray[np.float64]:
    """Gram matrix (C, C, S, S) of the subspaces of a mode's clusters.

    Cluster j of the mode stands for all cluster vectors whose entry for the mode is j. Its subspace
    is spanned by S rows: R for each owner of the mode's basis, owner by owner. gram[i, j] holds the
    scalar products of the rows of i and of j, as subtensors of the whole mode (K-CTA, Eqs. 14 and
    17; MK-CTA, Eq. 17). A mode that is not clustered has one cluster.
    """
    core, products = _reduce(model, mode)
    count, rank = core.shape[0], core.shape[-2]
    gram = np.zeros((count, rank, count, rank))
    for first in range(count):
        for second in range(first, count):
            part = core[first]
            for axis, product in enumerate(products):  # x_n (U_second^T U_first)
                part = np.moveaxis(
                    np.tensordot(product[second, :, first], part, (1, axis)), 0, axis
                )
            pairs = part.reshape(-1, *core.shape[-2:]), core[second].reshape(-1, *core.shape[-2:])
            block = (pairs[0] @ pairs[1].transpose(0, 2, 1)).sum(0)
            gram[first, :, second] = block
            gram[second, :, first] = block.T
    return _by_cluster(gram, model, mode)


def _reduce(
    model: ClusteredTucker, mode: str
) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
    """What the scalar products of a mode's subtensors depend on.

    Returns the core (clusters, R_n of modes whose basis varies with the cluster ..., R, the other
    ranks together), as if bases that do not vary were orthonormal, and for each mode that varies
    the products U_c^T U_d of its bases, (clusters, R_n, clusters, R_n).
    """
    core = model.core.astype(float)
    varying, products = [], []
    for axis, name in enumerate(model.modes, start=1):
        if name == mode:
            continue
        basis = model.bases[name].astype(float)
        if name in model.clusters or len(basis) > 1:
            dense = np.zeros((basis.shape[1], len(core), basis.shape[3]))
            for cluster in range(len(core)):
                rows, values = model.member_rows(name, cluster, np.arange(len(dense)))
                dense[rows, cluster] = values
            products.append(np.tensordot(dense, dense, (0, 0)))
            varying.append(axis)
        else:
            triangle = np.linalg.qr(basis[0, :, 0], "r")
            core = np.moveaxis(np.tensordot(triangle, core, (1, axis)), 0, axis)
    own = model.modes.index(mode) + 1
    others = [axis for axis in range(1, core.ndim) if axis != own and axis not in varying]
    core = np.ascontiguousarray(core.transpose(0, *varying, own, *others))
    return core.reshape(*core.shape[: len(varying) + 2], -1), products


def _by_cluster(
    gram: NDArray[np.float64], model: ClusteredTucker, mode: str
) -> NDArray[np.float64]:
    """(clusters, R, clusters, R) of cluster vectors as (C, C, S, S) of a mode's clusters."""
    counts, rank = list(model.clusters.values()), gram.shape[1]
    axes, own, owners = len(counts) + 1, 1, prod(counts)
    gram = gram.reshape(*counts, rank, *counts, rank)
    if mode in model.clusters:
        place = list(model.clusters).index(mode)
        gram = np.moveaxis(gram, (place, axes + place), (0, axes))
        own, owners = counts[place], owners // counts[place]
    gram = gram.reshape(own, owners, rank, own, owners, rank)
    if len(model.bases[mode]) < owners:  # one row for all owners: their subtensors add up
        gram = gram.sum((1, 4), keepdims=True)
        owners = 1
    return gram.reshape(own, owners * rank, own, owners * rank).transpose(0, 2, 1, 3)
