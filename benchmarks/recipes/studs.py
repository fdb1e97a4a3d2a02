"""Glossy plastic studs, each of its own colour: sharp highlights and shadows that move."""

from __future__ import annotations

import numpy as np

from addon.measure.patch import Patch

from .building import grid_faces, joined, new_mesh, new_patch, principled

PITCH, RADIUS, HEIGHT = 8e-3, 2.9e-3, 2.0e-3
ROWS = 3
AROUND = 48
COLOURS = np.array(
    [
        (0.55, 0.01, 0.01), (0.65, 0.42, 0.01), (0.01, 0.07, 0.45), (0.01, 0.25, 0.04),
        (0.60, 0.60, 0.58), (0.60, 0.13, 0.01), (0.02, 0.28, 0.40), (0.30, 0.02, 0.25),
    ]
)  # fmt: skip


def build() -> Patch:
    random = np.random.default_rng(7)
    studs = random.permutation(np.arange(ROWS * ROWS) % len(COLOURS)).reshape(ROWS, ROWS)
    plates, tops = [], []
    for row, column in np.ndindex(ROWS, ROWS):
        centre = PITCH * (np.array([column, row]) - (ROWS - 1) / 2)
        # Bricks a row wide, in the colour of one of their studs.
        plate = COLOURS[studs[row, 0]]
        plates.append(_plate(centre, plate))
        tops.append(_stud(centre, COLOURS[studs[row, column]], random))
    # alpha is the roughness squared: 0.12. All of a flat plate flashes at once, at a few of the
    # pairs of directions, and would outshine everything else if it were as smooth.
    glossy = principled("Glossy Plastic", Roughness=0.35, IOR=1.5)
    worn = principled("Worn Plastic", Roughness=0.5, IOR=1.5)
    return new_patch(
        "studs",
        ROWS * PITCH,
        new_mesh("studs", *joined(tops), glossy),
        new_mesh("plates", *joined(plates), worn),
    )


def _plate(centre: np.ndarray, colour: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    corners = np.array([(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)]) * PITCH + centre
    points = np.column_stack([corners, np.full(4, -HEIGHT / 2)])
    return points, grid_faces(1, 1), np.tile(colour, (4, 1))


def _stud(
    centre: np.ndarray, colour: np.ndarray, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A cylinder with a rounded edge and a slightly domed, slightly tilted top."""
    bevel, dome = 1.0e-3, 0.3e-3
    turn = np.linspace(0, np.pi / 2, 7)
    flat = np.linspace(RADIUS - bevel, 0, 9)
    rings = [
        (RADIUS, -HEIGHT / 2),
        *zip(
            RADIUS - bevel + bevel * np.cos(turn),
            HEIGHT / 2 - bevel + bevel * np.sin(turn),
            strict=True,
        ),
        *zip(flat[1:], HEIGHT / 2 + dome * (1 - (flat[1:] / flat[0]) ** 2), strict=True),
    ]
    radius, height = np.array(rings).T
    angle = np.linspace(0, 2 * np.pi, AROUND + 1)
    x, y = np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))
    tilt = random.normal(0, 0.04, 2)
    lifted = np.maximum(height, 0)[:, None] / (HEIGHT / 2) * (x * tilt[0] + y * tilt[1])
    z = np.repeat(height[:, None], AROUND + 1, 1) + lifted
    points = np.stack([x + centre[0], y + centre[1], z], -1).reshape(-1, 3)
    return points, grid_faces(len(radius) - 1, AROUND), np.tile(colour, (len(points), 1))
