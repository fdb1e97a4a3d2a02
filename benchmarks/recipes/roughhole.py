"""A rough, porous surface: deep rounded holes between walls, dark inside, with a fine grain."""

from __future__ import annotations

import numpy as np

from addon.measure.patch import Patch

from .building import height_field, new_patch, principled
from .noise import cell_distances, fractal

SIZE, DEPTH = 20e-3, 3.0e-3
COUNT = 384


def build() -> Patch:
    random = np.random.default_rng(3)
    nearest, second, cell = cell_distances(COUNT, 18, random)
    # Walls stand where a point is as far from one cell's seed as from the next one's.
    wall = np.clip((second - nearest) / 0.12, 0, 1)
    deep = random.uniform(0.35, 1.0, cell.max() + 1)[cell]
    hole = deep * wall**2 * (3 - 2 * wall)
    grain = fractal(COUNT, 5, random)
    height = DEPTH * (0.35 - hole) + 0.25e-3 * grain + 0.02e-3 * random.normal(size=hole.shape)
    clay = np.array((0.62, 0.40, 0.24))
    stain = np.array((0.30, 0.12, 0.07))
    mix = np.clip(0.5 + 0.6 * grain, 0, 1)[..., None]
    tint = random.uniform(0.75, 1.1, cell.max() + 1)[cell][..., None]
    colours = (mix * clay + (1 - mix) * stain) * tint
    rough = principled("Clay", Roughness=0.9)
    return new_patch("roughhole", SIZE, height_field("roughhole", height, SIZE, colours, rough))
