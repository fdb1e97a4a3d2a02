"""How the coefficients of a quality are divided among Y, U and V.

A coefficient of Y, U or V changes the squares of R, G and B by the squared norm of its column of
the matrix back to them. So those are kept that are the largest with that weight, over all three: of
white paper nearly all are Y's, of coloured thread fewer. The paper has one division for all
materials, 8 to 1 to 1.
"""

from __future__ import annotations

import nacre_native
import numpy as np

from ...datasets.dataset import Dataset
from ..domain import TO_RGB
from .ensemble import Ensemble
from .model import COEFFICIENT_BYTES, room_of
from .patches import channels_of, read_patches, tiling
from .transform import CHANNELS, Normalisation

_SEEN = 6  # patches that are coded to find out


def by_quality(
    dataset: Dataset,
    ensemble: Ensemble,
    normalised: Normalisation,
    quality: int,
    threads: int = 0,
) -> dict[str, int]:
    """Coefficients of a patch for each part, which take at most 2 `quality` bytes a texel."""
    keys = tuple(ensemble.dictionaries)
    room = room_of(quality, keys, ensemble.patch)
    if len(keys) == 1:
        return {keys[0]: room}
    origins = tiling(dataset.sizes["y"], dataset.sizes["x"], ensemble.patch)
    some = np.unique(np.linspace(0, len(origins) - 1, _SEEN).astype(int))
    found: dict[str, list[np.ndarray]] = {key: [] for key in keys}
    seen = [origins[index] for index in some]
    for _, patches in read_patches(dataset, normalised, ensemble.patch, seen):
        for key in keys:
            most = min(room, int(np.prod(ensemble.shape(key))))
            codes = nacre_native.code_patches(
                channels_of(patches, key), ensemble.dictionaries[key], most, threads=threads
            )
            weight = np.linalg.norm(TO_RGB[:, CHANNELS.index(key)])
            found[key].append(np.abs(codes["values"].ravel()) * weight)
    values = {key: np.concatenate(own) for key, own in found.items()}
    every = np.sort(np.concatenate(list(values.values())))[::-1]
    least = every[min(room * len(seen), len(every)) - 1]
    counts = {key: max(1, int((own > least).sum() // len(seen))) for key, own in values.items()}
    # What rounding left goes to the part that has most.
    largest = max(counts, key=lambda key: counts[key])
    counts[largest] += room - sum(counts.values())
    assert COEFFICIENT_BYTES * sum(counts.values()) <= 2 * quality * np.prod(ensemble.patch)
    return {key: min(count, int(np.prod(ensemble.shape(key)))) for key, count in counts.items()}
