"""Thin-plate spline weights between measured directions (K-CTA, Section 6.3.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def thin_plate_weights(
    measured: NDArray[np.floating], wanted: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Weights (m, n) that interpolate data at n measured unit directions at m wanted ones.

    The spline r^2 log r of the chord between directions, with a linear polynomial in x, y, z; it
    reproduces the data at the measured directions. Wanted directions lower than the lowest
    measured one take its elevation: a spline says nothing outside its data.
    """
    wanted = raise_to_lowest(measured, wanted)
    if len(measured) == 1:
        return np.ones((len(wanted), 1))
    count = len(measured)
    # About the centre, so that what directions on a circle or a line leave open (the polynomial's
    # columns then depend on each other) is constant in the pseudo-inverse's least solution.
    centre = measured.mean(0)
    linear = _linear(measured - centre)
    system = np.zeros((count + 4, count + 4))
    system[:count, :count] = _kernel(measured, measured)
    system[:count, count:] = linear
    system[count:, :count] = linear.T
    solution = np.linalg.pinv(system, hermitian=True)[:, :count]
    return np.hstack([_kernel(wanted, measured), _linear(wanted - centre)]) @ solution


def raise_to_lowest(
    measured: NDArray[np.floating], wanted: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Unit directions with an elevation of at least the lowest measured one's, azimuth kept."""
    z = np.maximum(wanted[:, 2], lowest(measured))
    xy = wanted[:, :2]
    reach = np.linalg.norm(xy, axis=-1)
    shrink = np.sqrt(np.maximum(0.0, 1.0 - z**2)) / np.maximum(reach, 1e-12)
    return np.column_stack([xy * shrink[:, None], z])


def horizon_fade(
    measured: NDArray[np.floating], wanted: NDArray[np.floating]
) -> NDArray[np.float64]:
    """How received light fades (m,) below the lowest measured light: cos / cos of the lowest.

    Values hold the light's cosine, so reflectance is what stays constant down to the horizon.
    """
    return np.clip(wanted[:, 2] / max(lowest(measured), 1e-6), 0.0, 1.0)


def lowest(measured: NDArray[np.floating]) -> float:
    """The cosine from the normal of the lowest measured direction, never below the horizon."""
    return max(0.0, float(measured[:, 2].min()))


def _kernel(a: NDArray[np.floating], b: NDArray[np.floating]) -> NDArray[np.float64]:
    square = np.maximum(2.0 - 2.0 * (a @ b.T), 0.0)
    square[square < 1e-14] = 1.0  # r^2 log r is 0 at r = 0 as at r = 1
    return 0.5 * square * np.log(square)


def _linear(points: NDArray[np.floating]) -> NDArray[np.float64]:
    return np.column_stack([np.ones(len(points)), points])
