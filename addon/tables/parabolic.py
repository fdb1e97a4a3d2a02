"""Parabolic maps of the hemisphere (Heidrich and Seidel 1999): direction <-> texel.

p = (x, y) / (1 + z) maps the upper hemisphere to the unit disc. Texel i of a map of even size N
stands for p = (i - N/2) / (N/2 - 1), so that the normal falls on the centre of texel N/2 rather
than on a corner where four texels meet and rounding would choose between them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def texel_directions(size: int) -> NDArray[np.float64]:
    """Unit directions (size, size, 3) of a map's texels, row = y; outside the disc its rim's."""
    steps = (np.arange(size) - size // 2) / (size // 2 - 1)
    p = np.stack(np.meshgrid(steps, steps), -1)
    p /= np.maximum(1.0, np.linalg.norm(p, axis=-1, keepdims=True))
    square = np.sum(p**2, axis=-1, keepdims=True)
    return np.concatenate([2.0 * p, 1.0 - square], -1) / (1.0 + square)


def place_of(directions: NDArray[np.floating], size: int) -> NDArray[np.floating]:
    """Where unit directions (..., 3) lie on a map, (..., 2) as (column, row); texels' centres are
    whole numbers.

    Directions below the horizon go to the rim, so that a silhouette has no holes.
    """
    xy, z = directions[..., :2], directions[..., 2:]
    reach = np.linalg.norm(xy, axis=-1, keepdims=True)
    p = xy / np.maximum(np.maximum(1.0 + z, reach), 1e-6)
    return p * (size // 2 - 1) + size // 2


def texel_of(directions: NDArray[np.floating], size: int) -> NDArray[np.intp]:
    """The texel (..., 2) as (column, row) nearest to unit directions (..., 3), see `place_of`."""
    return np.floor(place_of(directions, size) + 0.5).astype(np.intp)
