"""Loosely woven yarns of separate hair strands, with holes between them and stray fibres above."""

from __future__ import annotations

import numpy as np

from addon.measure.patch import Patch

from .building import hair, new_patch, principled

SIZE, YARNS = 12e-3, 4  # an even number, for the weave to repeat
STRANDS, STRAY = 16, 60
POINTS = 96
STRAND_RADIUS, YARN_RADIUS = 0.15e-3, 0.5e-3


def build() -> Patch:
    random = np.random.default_rng(2)
    wool = principled("Wool", Roughness=0.55, Sheen_Weight=0.4)
    along = np.linspace(-0.5, 0.5, POINTS)
    strands, colours = [], []
    for number, straight in np.ndindex(YARNS, 2):
        base = ((0.55, 0.42, 0.25), (0.06, 0.14, 0.30))[straight]
        yarn = _yarn(number, along, straight, random)
        tint = random.uniform(0.75, 1.15, (len(yarn), 1))
        strands += list(yarn)
        colours += list(np.array(base) * tint)
    for _ in range(STRAY):
        strands.append(_stray(random))
        colours.append(np.array((0.45, 0.40, 0.32)) * random.uniform(0.7, 1.2))
    radii = [STRAND_RADIUS] * (len(strands) - STRAY) + [0.4 * STRAND_RADIUS] * STRAY
    return new_patch("fibre", SIZE, hair("fibre", strands, radii, np.array(colours), wool))


def _yarn(number: int, along: np.ndarray, straight: int, random: np.random.Generator):
    """One yarn's strands (STRANDS, POINTS, 3), twisted round an axis that waves over and under."""
    pitch = SIZE / YARNS
    # Whole waves and whole turns of the twist, so that the yarn meets itself in the next patch.
    wave = np.cos(np.pi * (YARNS * (along + 0.5) - 0.5 + number))
    height = (-1.0 if straight else 1.0) * 0.9 * YARN_RADIUS * wave
    sway = 0.12 * pitch * np.sin(2 * np.pi * (along + random.uniform()))
    across = (number + 0.5) * pitch - SIZE / 2 + sway
    turn = 2 * np.pi * (random.uniform(size=(STRANDS, 1)) + 5 * along)
    radius = YARN_RADIUS * np.sqrt(random.uniform(0.02, 1, (STRANDS, 1)))
    radius = radius * (
        1 + 0.25 * np.sin(2 * np.pi * (2 * along + random.uniform(size=(STRANDS, 1))))
    )
    side = across + 1.15 * radius * np.cos(turn)
    up = height + 0.8 * radius * np.sin(turn)
    forward = np.broadcast_to(SIZE * along, side.shape)
    return np.stack([side, forward, up] if straight else [forward, side, up], -1)


def _stray(random: np.random.Generator) -> np.ndarray:
    """One loose fibre (24, 3) that curls above the weave."""
    step = np.linspace(0, 1, 24)
    start = random.uniform(-0.5, 0.5, 2) * SIZE
    angle = random.uniform(0, 2 * np.pi) + random.normal(0, 1.5) * step
    length = random.uniform(1.0e-3, 3.5e-3) / len(step)
    path = start + np.cumsum(length * np.stack([np.cos(angle), np.sin(angle)], -1), 0)
    rise = random.uniform(0.3e-3, 1.0e-3) * np.sin(np.pi * step) + random.uniform(-0.2e-3, 0.4e-3)
    return np.column_stack([path, rise])
