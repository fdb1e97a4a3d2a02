"""What both numpy fits need: the tensor of samples, bases from Gram matrices, first clusters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

DEPENDENT = 1e-6
"""Relative eigenvalue of a correlation matrix below which a direction counts as dependent."""

Array = NDArray[np.float32]


def tensor_of(samples: NDArray[Any]) -> Array:
    """Samples (light, view, y, x, channel) as a tensor (channels * light + channel, view, y, x)."""
    tensor = samples.transpose(0, 4, 1, 2, 3).astype(np.float32, order="C")
    return tensor.reshape(-1, *tensor.shape[2:])


def squared_norm(values: Array) -> float:
    """Sum of squares, in double for each row of the first axis."""
    rows = values.reshape(len(values), -1)
    return float(sum(np.float64(row @ row) for row in rows))


def leading_basis(gram: NDArray[Any], rank: int) -> Array:
    """The leading eigenvectors (I, rank) of a Gram matrix (I, I); zero columns past I."""
    vectors = np.linalg.eigh(gram.astype(np.float64))[1][:, ::-1][:, :rank]
    return np.pad(vectors, ((0, 0), (0, rank - vectors.shape[1]))).astype(np.float32)


def inverse_factor(gram: NDArray[Any]) -> NDArray[Any]:
    """F with F F^T the pseudo-inverse of a Gram matrix (..., n, n), taken after scaling to a
    correlation matrix; columns of dependent directions are zero."""
    diagonal = np.diagonal(gram, axis1=-2, axis2=-1)
    scale = np.where(diagonal > 0, 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1)), 0)
    values, vectors = np.linalg.eigh(scale[..., :, None] * gram * scale[..., None, :])
    kept = (values > DEPENDENT * values[..., -1:]) & (values > 0)
    weight = np.where(kept, 1 / np.sqrt(np.where(kept, values, 1)), 0)
    return scale[..., :, None] * vectors * weight[..., None, :]


def kmeans(points: NDArray[Any], clusters: int, seed: int = 0) -> NDArray[np.intp]:
    """The cluster of each point: k-means++ starts, Lloyd's iterations, the best of 32 starts."""
    random = np.random.default_rng(seed)
    best, lowest = np.zeros(len(points), np.intp), np.inf
    for _ in range(32):
        centres = points[[random.integers(len(points))]]
        while len(centres) < clusters:
            near = _squared_distances(points, centres).min(1)
            centres = np.vstack([centres, points[random.choice(len(points), p=near / near.sum())]])
        for _ in range(100):
            distances = _squared_distances(points, centres)
            labels = distances.argmin(1)
            if len(np.unique(labels)) < clusters:
                break
            moved = np.array([points[labels == c].mean(0) for c in range(clusters)])
            if np.array_equal(moved, centres):
                break
            centres = moved
        cost = distances.min(1).sum()
        if cost < lowest and len(np.unique(labels)) == clusters:
            best, lowest = labels, cost
    return best


def _squared_distances(points: NDArray[Any], centres: NDArray[Any]) -> NDArray[Any]:
    return np.square(points[:, None] - centres[None]).sum(2)


def in_batches(count: int, overlap: Callable[[int, int], bool]) -> list[int]:
    """Clusters in the order of their updates: those that share no element together, first fit.

    The compiled fit updates such at the same time (MK-CTA, Section 3.6).
    """
    batches: list[list[int]] = []
    for c in range(count):
        found = next((b for b in batches if not any(overlap(c, d) for d in b)), None)
        if found is None:
            batches.append([c])
        else:
            found.append(c)
    return [c for batch in batches for c in batch]


def split_empty(members: list[NDArray[np.intp]], errors: NDArray[Any]) -> Iterator[tuple[int, int]]:
    """Give each empty cluster the worse half of the cluster with the largest error (K-CTA, 5.3).

    members  the items of each cluster, changed in place
    errors   of each item

    Yields (filled, split) after each: a cluster may be filled and then split itself.
    """
    for empty in range(len(members)):
        if len(members[empty]):
            continue
        sums = [errors[items].sum() if len(items) > 1 else -1.0 for items in members]
        worst = int(np.argmax(sums))
        order = members[worst][np.argsort(errors[members[worst]], kind="stable")]
        half = (len(order) + 1) // 2
        members[worst], members[empty] = np.sort(order[:half]), np.sort(order[half:])
        yield empty, worst
