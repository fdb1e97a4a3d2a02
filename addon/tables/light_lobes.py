"""The light basis as sums of equal lobes, so that any environment is convolved in one filtering."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from .evaluate import light_rows
from .tables import Tables
from .world_picture import picture_directions, solid_angles

STEP = 0.121
"""Radians between lobes, half of that between the closest measured lights; closer ones brought the
vectors no nearer to the integral."""

_WIDTH = 2.0
"""Sharpness in units of 1 / step^2: wider lobes cancel each other, narrower ones leave gaps."""

_RIDGE = 1e-5
"""Keeps the weights small, of the lobes' mean square."""

_BELOW = -0.5
"""Lobes are compared with the rows down to this z: none of them may reach below the horizon."""


@dataclass(frozen=True)
class LightLobes:
    """Light basis rows as weighted lobes exp(sharpness (centre . omega - 1)).

    centres    (lobes, 3) unit directions in the tangent frame, with each its mirror image in y
    mirror     (lobes,) which lobe that is
    weights    (lobes, owners, channels, C_light, R_light) float32
    """

    centres: NDArray[np.float64]
    mirror: NDArray[np.intp]
    weights: NDArray[np.float32]
    sharpness: float


def light_lobes(tables: Tables, step: float = STEP) -> LightLobes:
    """The least-squares fit of a BTF's light rows, over the sphere and zero below the horizon.

    `step` is the angle between lobes in radians. ValueError for tables of occlusion.
    """
    centres = _centres(step)
    sharpness = _WIDTH / step**2
    height, width = 90, 180
    directions = picture_directions(height, width).reshape(-1, 3)
    weights = np.repeat(solid_angles(height, width), width)
    near = directions[:, 2] > _BELOW
    directions, weights = directions[near], weights[near]
    lobes = np.exp(sharpness * (directions @ centres.T - 1.0))
    rows = light_rows(tables, directions).transpose(0, 3, 1, 2, 4)
    weighted = (lobes * weights[:, None]).T
    square = weighted @ lobes
    square += np.eye(len(square)) * (_RIDGE * np.trace(square) / len(square))
    found = np.linalg.solve(square, weighted @ rows.reshape(len(rows), -1))
    mirror = np.argmax(centres * (1, -1, 1) @ centres.T, 1)
    return LightLobes(
        centres, mirror, found.reshape(-1, *rows.shape[1:]).astype(np.float32), sharpness
    )


def _centres(step: float) -> NDArray[np.float64]:
    """Rings of directions down to just below the horizon, each symmetric in y."""
    rings = [np.array([[0.0, 0.0, 1.0]])]
    for ring in range(1, round(pi / 2 / step + 0.5) + 1):
        theta = ring * step
        count = 2 * max(1, round(pi * np.sin(min(theta, pi / 2)) / step))
        phi = (np.arange(count) + 0.5) * (2.0 * pi / count)
        rings.append(
            np.column_stack(
                [
                    np.sin(theta) * np.cos(phi),
                    np.sin(theta) * np.sin(phi),
                    np.full(count, np.cos(theta)),
                ]
            )
        )
    return np.concatenate(rings)
