"""View-dependent occlusion: masks to signed distances and back (K-CTA, Sections 6.2 and 6.3.3).

Covered is mask 1 and a positive distance, a hole is mask 0 and a negative one: the sign of Eq. 26,
which is the opposite of what Section 6.2 states.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .dataset import Dataset

REACH = 2.0
"""Distances end this many texels from a boundary.

The paper lets them grow without end. Those far from every boundary then make up most of the energy
that a fit approximates, and say nothing of the mask: thin fibres drown. `benchmarks/occlusion.py`
has both, and what other ends give.
"""

MAPPINGS = {"mask": (0.5, 1.0), "signed-distance": (0.05, 12.0)}
"""Threshold T and weight W of the visibility mapping (Eq. 26), as the paper's Figure 7 has them."""


def signed_distance(
    masks: NDArray[np.generic], periodic: bool, reach: float = REACH
) -> NDArray[np.float32]:
    """Distances (view, y, x) in [-1, 1] of masks (view, y, x), covered where at least 0.5.

    The Euclidean distance in texels from each texel to the nearest one of the other sort
    (Danielsson 1980), positive where covered, over `reach`, where they end; over the largest one of
    all views where that is infinite, as in the paper. A view all of one sort is 1 or -1. Distances
    wrap where the patch is `periodic`.
    """
    covered = np.asarray(masks) >= 0.5
    distances = np.empty(covered.shape)
    for distance, mask in zip(distances, covered, strict=True):
        distance[...] = np.where(
            mask, _distance_to(~mask, periodic, reach), -_distance_to(mask, periodic, reach)
        )
    if np.isinf(reach):
        reach = np.abs(distances).max(initial=0.0, where=np.isfinite(distances)) or 1.0
    return np.clip(distances / reach, -1.0, 1.0).astype(np.float32)


def visibility(values: NDArray[np.floating], value: str) -> NDArray[np.floating]:
    """Eq. 26: how far masks or signed distances, as `value` says, are visible, in [0, 1]."""
    threshold, weight = MAPPINGS[value]
    return np.where(values >= threshold, 1.0, weight * np.maximum(values, 0.0))


def is_covered(values: NDArray[np.floating], value: str) -> NDArray[np.bool_]:
    """Which texels of approximated masks or signed distances, as `value` says, are covered.

    Of distances those at all visible by Eq. 26 (Section 6.3.3, step 5), of masks the fully visible
    ones: what a fit leaves of 0 is as often above as below.
    """
    return np.asarray(values > 0.0 if value == "signed-distance" else values >= MAPPINGS[value][0])


def with_value(dataset: Dataset, value: str) -> Dataset:
    """An occlusion dataset with its samples as masks or as signed distances, in memory if changed.

    `value` is one of VALUES.
    """
    if dataset.value == value:
        return dataset
    masks = is_covered(dataset.samples, dataset.value)
    if value == "mask":
        samples, conversion = masks.astype(np.float32), "signed distances to masks"
    else:
        samples = signed_distance(masks, dataset.periodic)
        conversion = f"masks to signed distances, up to {REACH:g} texels"
    conversions = [*dataset.source.get("conversions", []), conversion]
    source = {**dataset.source, "conversions": conversions}
    return replace(dataset, value=value, samples=samples, source=source)


def _distance_to(targets: NDArray[np.bool_], periodic: bool, reach: float) -> NDArray[np.float64]:
    """Distance in texels (y, x) to the nearest target; beyond `reach` no less than that.

    Squared distances are the least of f(q) + |p - q|^2 over all q, f being 0 at targets; that goes
    one axis after the other.
    """
    squared = np.where(targets, 0.0, np.inf)
    for axis, size in enumerate(targets.shape):
        source = squared.copy()
        if not periodic:  # as much emptiness behind the patch, so that it does not wrap onto itself
            source = np.concatenate([source, np.full_like(source, np.inf)], axis)
        for step in range(1, source.shape[axis] // 2 + 1):
            if step > reach or step**2 >= squared.max():
                break
            for shift in (step, -step):
                shifted = np.roll(source, shift, axis).take(range(size), axis)
                np.minimum(squared, shifted + step**2, out=squared)
    return np.sqrt(squared)
