"""Five-harness satin: long smooth floats of low relief with a soft sheen along the thread."""

from __future__ import annotations

import numpy as np

from addon.measure.patch import Patch

from .building import height_field, new_patch, principled

SIZE, THREADS = 6e-3, 10
PER_THREAD = 32


def build() -> Patch:
    random = np.random.default_rng(5)
    count = THREADS * PER_THREAD
    place = (np.arange(count) + 0.5) / PER_THREAD
    x, y = np.meshgrid(place, place)
    warp, weft = x.astype(int), y.astype(int)
    # The warp goes under one weft in five, two threads further on with each row.
    phase = (y - (2 * warp + 0.5)) % 5
    under = np.exp(-((np.minimum(phase, 5 - phase) / 0.42) ** 2))
    across_warp = 1 - (2 * (x - warp) - 1) ** 2
    across_weft = 1 - (2 * (y - weft) - 1) ** 2
    top = 1.0 * np.sqrt(across_warp) * (1 - 1.1 * under)
    bottom = 0.75 * np.sqrt(across_weft) * (0.25 + 0.75 * under)
    is_warp = top > bottom
    # Twisted fibres show as a fine slanted grain.
    twist = np.where(is_warp, 6 * (x - warp) + 1.5 * y, 6 * (y - weft) - 1.5 * x)
    height = 0.09e-3 * np.maximum(top, bottom) + 1.5e-6 * np.sin(2 * np.pi * twist)
    shade = random.uniform(0.9, 1.1, (2, THREADS))
    colours = np.where(
        is_warp[..., None],
        np.array((0.42, 0.05, 0.09)) * shade[0][warp][..., None],
        np.array((0.28, 0.03, 0.10)) * shade[1][weft][..., None],
    )
    silk = principled("Silk", Roughness=0.42, Sheen_Weight=0.3, Sheen_Roughness=0.4)
    return new_patch("satin", SIZE, height_field("satin", height, SIZE, colours, silk))
