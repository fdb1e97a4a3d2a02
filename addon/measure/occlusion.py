"""Virtual measurement of an occlusion texture: where open meso-structure covers what is behind."""

from __future__ import annotations

import numpy as np

from .instrument import new_instrument, render
from .patch import Patch


def measure_occlusion(
    patch: Patch, view: np.ndarray, *, texels: int = 64, samples: int = 1, seed: int = 0
) -> np.ndarray:
    """How much of each texel the patch covers, seen from each view: (view, y, x) float32 in [0, 1].

    `view` (V, 3) are unit vectors above the patch. One sample goes through the texel's centre and
    gives a mask, 1 covered and 0 hole; more give the mean over the texel. Raises NacreError for an
    empty patch and directions below the horizon.
    """
    nothing = np.empty((0, 3))
    with new_instrument(patch, view, nothing, texels, samples, centred=samples == 1) as instrument:
        scene, tiles = instrument
        scene.cycles.max_bounces = 0
        return render(scene, tiles, seed)[..., 3]
