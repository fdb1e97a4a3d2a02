"""An open net of square knotted cords: thin structure with large holes."""

from __future__ import annotations

import numpy as np

from addon.measure.patch import Patch

from .building import hair, new_patch, principled

SIZE, CORDS = 20e-3, 3
POINTS = 120
RADIUS = 0.45e-3


def build() -> Patch:
    random = np.random.default_rng(9)
    along = np.linspace(-0.5, 0.5, POINTS)
    pitch = SIZE / CORDS
    strands = []
    for number, straight, ply in np.ndindex(CORDS, 2, 3):
        turn = 2 * np.pi * (ply / 3 + 6 * along)
        bend = random.normal(0, 0.07 * pitch, 3)
        sway = sum(bend[k] * np.sin(2 * np.pi * (k + 1) * along + k) for k in range(3))
        if ply == 0:
            axis = (number + 0.5) * pitch - SIZE / 2 + sway
        side = axis + 0.7 * RADIUS * np.cos(turn)
        up = (0.5 - straight) * 1.6 * RADIUS + 0.7 * RADIUS * np.sin(turn)
        forward = SIZE * along
        strands.append(np.stack([side, forward, up] if straight else [forward, side, up], -1))
    cord = principled("Cord", Roughness=0.6)
    colours = np.tile((0.5, 0.35, 0.12), (len(strands), 1))
    radii = [0.55 * RADIUS] * len(strands)
    return new_patch("net", SIZE, hair("net", strands, radii, colours, cord))
