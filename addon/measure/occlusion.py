"""Virtual measurement of an occlusion texture: where open meso-structure covers what is behind."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..datasets.dataset import KINDS, Dataset, DatasetWriter, check_destination, open_dataset
from ..datasets.occlusion import signed_distance
from ..errors import Cancelled
from .instrument import new_instrument, program
from .patch import Patch
from .settings import Settings

Progress = Callable[[float, str], bool]


def measure_occlusion(
    patch: Patch,
    path: str | Path,
    view: np.ndarray,
    *,
    width: int = 64,
    value: str = "mask",
    progress: Progress | None = None,
) -> Dataset:
    """Measure what a patch covers into the occlusion dataset `path` and open it.

    `view` (V, 3) are unit vectors above the patch, `width` the texels along its width. One ray goes
    through each texel's centre; `value` is "mask", 1 covered and 0 hole, or "signed-distance" (see
    `signed_distance`). Raises NacreError for an empty patch, directions below the horizon and a
    disk that cannot be written, Cancelled when `progress` answers False.
    """
    path = check_destination(path)
    if progress and not progress(0.0, "Measuring"):
        raise Cancelled
    texels = Settings(width).texels(patch.size)
    samples = (coverage(patch, view, texels) >= 0.5).astype(np.float32)
    if value == "signed-distance":
        samples = signed_distance(samples, periodic=True)
    description = {
        "nacre": 1,
        "kind": "occlusion",
        "axes": list(KINDS["occlusion"]),
        "view": view.tolist(),
        "value": value,
        "patch_size": list(patch.size),
        "periodic": True,
        "noise_floor_db": None,
        "source": {
            "format": "Cycles",
            "file": patch.name or patch.collection.name,
            "conversions": [f"rendered with {program()}"],
        },
    }
    with DatasetWriter(path, description, samples.shape, np.float16) as writer:
        writer.write(samples)
    return open_dataset(path)


def coverage(
    patch: Patch, view: np.ndarray, texels: tuple[int, int], samples: int = 1
) -> np.ndarray:
    """How much of each texel a patch covers, seen from each view: (view, y, x) float32 in [0, 1].

    One sample goes through the texel's centre; more give the mean over the texel. Raises NacreError
    for an empty patch and directions below the horizon.
    """
    nothing = np.empty((0, 3))
    with new_instrument(patch, view, nothing, texels, samples, centred=samples == 1) as instrument:
        return instrument.picture(0)[..., 3]
