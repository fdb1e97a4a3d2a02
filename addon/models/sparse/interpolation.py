"""Other directions, interpolated among the coefficients (SparseBTF, Eq. 6)."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ...errors import NacreError
from ..interpolation import raise_to_lowest
from .model import SparseBtf
from .transform import Normalisation

KERNELS = ("linear", "gaussian")

_NEAREST = 10  # directions among which the triangle around another one is looked for
_GAUSSIAN = 8  # neighbours that a Gaussian kernel reaches


def at_directions(
    model: SparseBtf,
    lights: NDArray[np.floating],
    views: NDArray[np.floating],
    kernel: str = "linear",
) -> SparseBtf:
    """The model at other unit directions (n, 3): rows of the light and view matrices are mixed, and
    means and deviations likewise, so a value costs what one at a measured direction does.

    The same as mixing the normalised values of all combinations of neighbours, by linearity.
    """
    if kernel not in KERNELS:
        raise NacreError(f"kernel {kernel!r}: expected {' or '.join(KERNELS)}")
    ensemble, normalised = model.ensemble, model.normalised
    by_light = weights(ensemble.light, lights, kernel)
    by_view = weights(ensemble.view, views, kernel)

    def mixed(images: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(by_light @ images @ by_view.T, np.float32)

    dictionaries = {
        key: (y, x, by_light @ light, by_view @ view, *colour)
        for key, (y, x, light, view, *colour) in ensemble.dictionaries.items()
    }
    return replace(
        model,
        ensemble=replace(
            ensemble,
            light=np.asarray(lights, np.float64),
            view=np.asarray(views, np.float64),
            dictionaries=dictionaries,
        ),
        normalised=Normalisation(
            mixed(normalised.mean),
            mixed(normalised.deviation),
            normalised.offset,
        ),
        dataset={
            **model.dataset,
            "light": np.asarray(lights).tolist(),
            "view": np.asarray(views).tolist(),
        },
    )


def weights(
    measured: NDArray[np.floating], wanted: NDArray[np.floating], kernel: str
) -> NDArray[np.float32]:
    """Weights (m, n), each row of sum 1, of n measured unit directions for m wanted ones.

    linear    of the triangle of neighbours on the sphere that a direction lies in
    gaussian  by angle, as wide as neighbours are apart

    Directions lower than the lowest measured one take its elevation.
    """
    raised = raise_to_lowest(measured, wanted)
    row = _triangle if kernel == "linear" else _gaussian
    return np.array([row(measured, direction) for direction in raised], np.float32)


def _triangle(measured: NDArray[np.floating], wanted: NDArray[np.floating]) -> NDArray[np.float64]:
    found = np.zeros(len(measured))
    near = np.argsort(-(measured @ wanted), kind="stable")[:_NEAREST]
    if measured[near[0]] @ wanted > 1.0 - 1e-12 or len(near) < 3:
        found[near[0]] = 1.0
        return found
    corners = np.array(list(combinations(near, 3)))
    # wanted = sum of w_i times the corners, w >= 0 inside; small triangles are neighbours'.
    sides = measured[corners].transpose(0, 2, 1)
    flat = np.abs(np.linalg.det(sides)) < 1e-9
    sides[flat] = np.eye(3)
    shares = np.linalg.solve(sides, np.broadcast_to(wanted, (len(sides), 3))[..., None])[..., 0]
    outside = np.maximum(-shares.min(1), 0.0)
    size = (1.0 - measured[corners] @ wanted).max(1)
    # Beyond the outermost directions none is around: the one that it is least outside of.
    best = np.lexsort((size, np.round(outside, 9), flat))[0]
    share = np.maximum(shares[best], 0.0)
    found[corners[best]] = share / share.sum()
    return found


def _gaussian(measured: NDArray[np.floating], wanted: NDArray[np.floating]) -> NDArray[np.float64]:
    found = np.zeros(len(measured))
    angles = np.arccos(np.clip(measured @ wanted, -1.0, 1.0))
    near = np.argsort(angles, kind="stable")[:_GAUSSIAN]
    around = np.arccos(np.clip(measured @ measured[near[0]], -1.0, 1.0))
    spacing = np.sort(around)[1:4].mean() if len(measured) > 1 else 1.0
    # The nearest always counts, however far away it is.
    exponent = angles[near] ** 2 - angles[near[0]] ** 2
    share = np.exp(-0.5 * exponent / (0.5 * spacing) ** 2)
    found[near] = share / share.sum()
    return found
