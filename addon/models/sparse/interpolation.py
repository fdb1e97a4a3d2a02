"""Other directions, interpolated among the coefficients (SparseBTF, Eq. 6)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ...errors import NacreError
from ..clustered_tucker import Part
from ..interpolation import raise_to_lowest
from .model import SparseBtf
from .transform import Normalisation

KERNELS = ("linear", "gaussian")

_NEAREST = 10  # directions among which the triangle around another one is looked for
_GAUSSIAN = 8  # neighbours that a Gaussian kernel reaches
_CHUNK = 512  # directions that are looked for at a time


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
    ensemble, normalised = model.ensemble, model.normalised
    by_light = weights(ensemble.light, lights, kernel)
    by_view = weights(ensemble.view, views, kernel)

    def mixed(images: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.einsum("al,bv,lv...->ab...", by_light, by_view, images, optimize=True)

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


@dataclass(frozen=True)
class Images:
    """A model at other directions by mixing images: linear colours are decoded at every neighbour
    of a light and of a view, nine to 64 of them, and mixed. What Eq. 6 saves, to compare with.

    by_light (m, lights), by_view (n, views): shares of the measured directions.
    """

    model: SparseBtf
    by_light: NDArray[np.float32]
    by_view: NDArray[np.float32]

    def decode(
        self,
        light: Part = slice(None),
        view: Part = slice(None),
        y: Part = slice(None),
        x: Part = slice(None),
    ) -> NDArray[np.float32]:
        """Linear samples (light, view, y, x, channel) of one block, as a model's `decode`."""
        by_light, by_view = self.by_light[light], self.by_view[view]
        views = np.flatnonzero(by_view.any(0))
        found = []
        for shares in by_light:
            lights = np.flatnonzero(shares)
            mixed: NDArray[np.float32] | float = 0.0
            for own in views:  # one at a time: a few images are in memory beside the result
                images = self.model.decode(lights, slice(own, own + 1), y, x)[:, 0]
                image = np.tensordot(shares[lights], images, 1)
                mixed = mixed + by_view[:, own, None, None, None] * image
            found.append(mixed)
        return np.array(found, np.float32)


def images_at_directions(
    model: SparseBtf,
    lights: NDArray[np.floating],
    views: NDArray[np.floating],
    kernel: str = "linear",
) -> Images:
    """The model at other unit directions, by mixing images instead of coefficients."""
    ensemble = model.ensemble
    return Images(
        model, weights(ensemble.light, lights, kernel), weights(ensemble.view, views, kernel)
    )


def weights(
    measured: NDArray[np.floating], wanted: NDArray[np.floating], kernel: str
) -> NDArray[np.float32]:
    """Weights (m, n), each row of sum 1, of n measured unit directions for m wanted ones.

    linear    of the triangle of neighbours on the sphere that a direction lies in
    gaussian  by angle, as wide as neighbours are apart

    Directions lower than the lowest measured one take its elevation. Raises NacreError for a kernel
    that is not there.
    """
    if kernel not in KERNELS:
        raise NacreError(f"kernel {kernel!r}: expected {' or '.join(KERNELS)}")
    raised = raise_to_lowest(measured, wanted)
    rows = _triangles if kernel == "linear" else _gaussians
    found = np.zeros((len(raised), len(measured)), np.float32)
    for first in range(0, len(raised), _CHUNK):
        part = slice(first, first + _CHUNK)
        numbers, shares = rows(np.asarray(measured, np.float64), raised[part])
        np.put_along_axis(found[part], numbers, shares.astype(np.float32), 1)
    return found


_Rows = tuple[NDArray[np.intp], NDArray[np.float64]]
"""The measured directions that each wanted one mixes, and their shares: (n, neighbours)."""


def _triangles(measured: NDArray[np.float64], wanted: NDArray[np.floating]) -> _Rows:
    cosine = wanted @ measured.T
    near = np.argsort(-cosine, axis=1, kind="stable")[:, :_NEAREST]
    if near.shape[1] < 3:
        return near[:, :1], np.ones((len(wanted), 1))
    corners = near[:, list(combinations(range(near.shape[1]), 3))]
    # wanted = sum of w_i times the corners, w >= 0 inside, by Cramer's rule; small triangles are
    # neighbours'.
    a, b, c = (measured[corners[..., corner]] for corner in range(3))
    opposite = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], -2)
    volume = np.sum(a * opposite[..., 0, :], -1)
    flat = np.abs(volume) < 1e-9
    shares = np.einsum("ntcd,nd->ntc", opposite, wanted) / np.where(flat, 1.0, volume)[..., None]
    outside = np.maximum(-shares.min(-1), 0.0)
    size = 1.0 - np.take_along_axis(cosine[:, None], corners, 2).min(-1)
    # Beyond the outermost directions none is around: the one that it is least outside of.
    best = np.lexsort((size, np.round(outside, 9), flat))[:, :1, None]
    share = np.maximum(np.take_along_axis(shares, best, 1)[:, 0], 0.0)
    corner = np.take_along_axis(corners, best, 1)[:, 0]
    # A measured direction itself, or one beside directions that are all in a plane.
    single = (cosine.max(1) > 1.0 - 1e-12) | np.take_along_axis(flat, best[..., 0], 1)[:, 0]
    corner[single] = near[single, :1]
    share[single] = 1.0
    return corner, np.where(single[:, None], 1.0, share / share.sum(1, keepdims=True))


def _gaussians(measured: NDArray[np.float64], wanted: NDArray[np.floating]) -> _Rows:
    angles = np.arccos(np.clip(wanted @ measured.T, -1.0, 1.0))
    near = np.argsort(angles, axis=1, kind="stable")[:, :_GAUSSIAN]
    apart = np.sort(np.arccos(np.clip(measured @ measured.T, -1.0, 1.0)), axis=1)[:, 1:4]
    spacing = apart.mean(1)[near[:, :1]] if len(measured) > 1 else 1.0
    # The nearest always counts, however far away it is.
    angle = np.take_along_axis(angles, near, 1)
    share = np.exp(-0.5 * (angle**2 - angle[:, :1] ** 2) / (0.5 * spacing) ** 2)
    return near, share / share.sum(1, keepdims=True)
