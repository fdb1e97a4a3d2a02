"""How the coefficients of a quality are divided among Y, U and V.

A coefficient of Y, U or V changes the squares of R, G and B by the squared norm of its column of
the matrix back to them. So those are kept that are the largest with that weight, over all three: of
white paper nearly all are Y's, of coloured thread fewer. The paper has one division for all
materials, 8 to 1 to 1.
"""

from __future__ import annotations

from collections.abc import Mapping

import nacre_native
import numpy as np
from numpy.typing import NDArray

from ...datasets.dataset import Dataset
from ..domain import TO_RGB
from .ensemble import Ensemble
from .model import room_of
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
    """Coefficients of a patch for each part, which take at most 2 `quality` bytes a texel.

    NacreError where not even one for each part does."""
    keys = tuple(ensemble.dictionaries)
    sizes = {key: int(np.prod(ensemble.shape(key))) for key in keys}
    room = room_of(quality, keys, ensemble.patch)
    origins = tiling(dataset.sizes["y"], dataset.sizes["x"], ensemble.patch)
    some = np.unique(np.linspace(0, len(origins) - 1, _SEEN).astype(int))
    found: dict[str, list[NDArray[np.floating]]] = {key: [] for key in keys}
    seen = [origins[index] for index in some]
    for _, patches in read_patches(dataset, normalised, ensemble.patch, seen):
        for key in keys:
            most = min(room, sizes[key])
            codes = nacre_native.code_patches(
                channels_of(patches, key), ensemble.dictionaries[key], most, threads=threads
            )
            # Of three channels together there is nothing to divide, whatever they weigh.
            weight = np.linalg.norm(TO_RGB[:, CHANNELS.index(key)]) if len(key) == 1 else 1.0
            found[key].append(np.abs(codes["values"].ravel()) * weight)
    counts = divided({key: np.concatenate(own) for key, own in found.items()}, room, len(seen))
    return {key: min(count, sizes[key]) for key, count in counts.items()}


def divided(
    magnitudes: Mapping[str, NDArray[np.floating]], room: int, patches: int
) -> dict[str, int]:
    """`room` coefficients of a patch, at least one for each part, by how many of the largest of all
    are each part's: `magnitudes` of some patches' coefficients, as they count."""
    every = np.sort(np.concatenate(list(magnitudes.values())))[::-1]
    least = every[min(room * patches, len(every)) - 1]
    counts = {key: max(1, int((own > least).sum() // patches)) for key, own in magnitudes.items()}
    # What rounding left goes to the part that has most, which also makes up for a part's only one.
    largest = max(counts, key=lambda key: counts[key])
    counts[largest] += room - sum(counts.values())
    return counts
