"""Coloured lacquer over hammered metal: broad coloured reflections under a clear coat."""

from __future__ import annotations

import numpy as np

from addon.measure.patch import Patch

from .building import height_field, new_patch, principled
from .noise import cell_distances, fractal

SIZE = 30e-3
COUNT = 320


def build() -> Patch:
    random = np.random.default_rng(11)
    nearest, second, cell = cell_distances(COUNT, 30, random)
    dimple = np.clip(nearest / 0.12, 0, 1.2) ** 2
    edge = np.exp(-(((second - nearest) / 0.02) ** 2))
    grain = fractal(COUNT, 4, random)
    height = 0.45e-3 * (dimple - 0.5 * edge * dimple) + 0.02e-3 * grain
    palette = np.array(
        [(0.75, 0.28, 0.04), (0.60, 0.05, 0.02), (0.80, 0.50, 0.10), (0.08, 0.30, 0.33)]
    )
    colours = palette[random.integers(0, 4, cell.max() + 1)][cell]
    colours = colours * (0.85 + 0.25 * grain)[..., None].clip(0.5, 1.15)
    lacquer = principled(
        "Lacquer", Metallic=0.8, Roughness=0.45, Coat_Weight=1.0, Coat_Roughness=0.35
    )
    return new_patch("lacquer", SIZE, height_field("lacquer", height, SIZE, colours, lacquer))
