"""Tables over the unit square that depend on parameters, as the RGL database's BRDFs use them.

A table (slices, ..., h, w) is interpolated bilinearly between its h x w points, which the edges of
the unit square hold, and linearly between slices. Positions are (x, y), x along the last axis.
`Blend` says for each of n positions which slices, and how much of each.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Blend:
    """Slices (k, n) and their weights (k, n) for n positions."""

    slices: np.ndarray
    weights: np.ndarray

    def of(self, table: np.ndarray, *index: np.ndarray) -> np.ndarray:
        """(n, ...) of a table (slices, y, x, ...) at (y, x), or of one (slices, y, ...) at y."""
        return np.einsum("kn,kn...->n...", self.weights, table[(self.slices, *index)])


def blend(parameters: list[tuple[np.ndarray, np.ndarray]]) -> Blend:
    """For n positions at parameters: pairs of increasing values and the n parameters.

    Slices are numbered with the last parameter fastest; beyond the first and the last value there
    is nothing but that value.
    """
    count = len(parameters[0][1])
    slices = np.zeros((1, count), np.intp)
    weights = np.ones((1, count))
    for values, wanted in parameters:
        if len(values) == 1:
            continue
        first = np.clip(np.searchsorted(values, wanted, "left") - 1, 0, len(values) - 2)
        low, high = values[first], values[first + 1]
        fraction = np.clip((wanted - low) / (high - low), 0.0, 1.0)
        slices = np.concatenate([slices * len(values) + first, slices * len(values) + first + 1])
        weights = np.concatenate([weights * (1.0 - fraction), weights * fraction])
    return Blend(slices, weights)


def patches(position: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Which of count - 1 patches, and where in it, positions (n,) in [0, 1] are."""
    scaled = np.clip(position, 0.0, 1.0) * (count - 1)
    patch = np.minimum(scaled.astype(np.intp), count - 2)
    return patch, scaled - patch


def interpolate(table: np.ndarray, x: np.ndarray, y: np.ndarray, of: Blend) -> np.ndarray:
    """(n, ...) of a table (slices, h, w, ...) at positions (n,) in the unit square."""
    j, b = patches(y, table.shape[1])
    i, a = patches(x, table.shape[2])
    more = (1,) * (table.ndim - 3)
    a, b = a.reshape(-1, *more), b.reshape(-1, *more)
    low = (1.0 - a) * of.of(table, j, i) + a * of.of(table, j, i + 1)
    high = (1.0 - a) * of.of(table, j + 1, i) + a * of.of(table, j + 1, i + 1)
    result: np.ndarray = (1.0 - b) * low + b * high
    return result


class Warp:
    """The map that makes a density uniform: of y by its marginal, of x in each row.

    `density` (slices, h, w) is not negative; each slice is scaled to an integral of 1. The inverse
    of importance sampling by marginal and conditional distribution, but exact for the bilinear
    density (Dupuy and Jakob, "An Adaptive Parameterization for Efficient Material Acquisition and
    Rendering", 2018).
    """

    def __init__(self, density: np.ndarray) -> None:
        density = density.astype(np.float64)
        rows = _cumulative(density)
        columns = _cumulative(rows[..., -1])
        total = columns[..., -1]
        scale = np.divide(1.0, total, out=np.zeros_like(total), where=total > 0.0)
        self._density = density * scale[:, None, None]
        self._rows = rows * scale[:, None, None]
        self._columns = columns * scale[:, None]

    def __call__(self, x: np.ndarray, y: np.ndarray, of: Blend) -> tuple[np.ndarray, np.ndarray]:
        """Where positions (n,) go; both in [0, 1]."""
        _, height, width = self._density.shape
        (j, b), (i, a) = patches(y, height), patches(x, width)
        last = np.full_like(i, width - 1)
        left = _mix(of.of(self._density, j, i), of.of(self._density, j + 1, i), b)
        right = _mix(of.of(self._density, j, i + 1), of.of(self._density, j + 1, i + 1), b)
        start = _mix(of.of(self._rows, j, i), of.of(self._rows, j + 1, i), b)
        this, following = of.of(self._rows, j, last), of.of(self._rows, j + 1, last)
        row = _mix(this, following, b)
        inside = start + a * _mix(left, right, 0.5 * a) / (width - 1)
        x = np.divide(inside, row, out=np.zeros_like(row), where=row > 0.0)
        y = of.of(self._columns, j) + b * _mix(this, following, 0.5 * b) / (height - 1)
        return np.clip(x, 0.0, 1.0), np.clip(y, 0.0, 1.0)


def _mix(first: np.ndarray, second: np.ndarray, weight: np.ndarray) -> np.ndarray:
    return first + weight * (second - first)


def _cumulative(values: np.ndarray) -> np.ndarray:
    """Integrals from 0 along the last axis (..., n), linear between n points of [0, 1]."""
    steps = 0.5 * (values[..., 1:] + values[..., :-1]) / (values.shape[-1] - 1)
    return np.concatenate([np.zeros_like(values[..., :1]), np.cumsum(steps, -1)], -1)
