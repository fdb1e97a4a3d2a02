"""A map of texture coordinates that tiles a material without visible repetition.

Appearance-space texture synthesis (Lefebvre and Hoppe 2006), as K-CTA uses it (Section 6.3.3): each
texel of the map says which texel of the patch stands there. Texels are alike when they and what is
round them look alike from several views under several lights. From coarse to fine the map's
coordinates are doubled and corrected: each texel chooses among those that continue its neighbours,
and those most like them, the one whose neighbourhood fits best. The map repeats seamlessly itself.

The paper jitters coordinates at random, which breaks the order of what is woven. Here the first,
coarse coordinates are moved, and only by what leaves the patch like itself: whole threads.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..datasets.directions import spherical_to_unit
from ..errors import Cancelled, NacreError
from .any_tables import AnyTables, evaluate_pictures

SIZE = 256
"""Texels along the map."""

_LIGHTS = spherical_to_unit([15.0, 50.0, 50.0, 50.0, 50.0], [0.0, 45.0, 135.0, 225.0, 315.0])
_VIEWS = spherical_to_unit([0.0, 45.0, 45.0], [0.0, 60.0, 240.0])
_NUMBERS = 8  # of an appearance vector, as in the paper
_ALIKE = 3  # texels that a neighbour's coordinates stand for: itself and those most like it
_APART = 0.06  # of the patch, between those
_INCOHERENT = 1.2  # times the error of texels that are only like a neighbour's
_PASSES = 4  # of correction at each level
_COARSEST = 2  # powers of two by which the first step is smaller than the patch
_STRICT = 0.3  # how much less alike than the best a move may be, of the variance
_DIAGONALS = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
_AROUND = np.array([(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1)])

Vectors = NDArray[np.float32]  # (Y, X, numbers)
Coordinates = NDArray[np.intp]  # (..., 2): y and x


def synthesize_coordinates(
    tables: AnyTables,
    size: int = SIZE,
    seed: int = 0,
    progress: Callable[[float, str], bool] | None = None,
) -> NDArray[np.uint16]:
    """For each texel of a map (size, size) the patch's texel (row y, column x) to read there:
    (size, size, 2). The same for the same seed.

    NacreError when `size` is no multiple of the coarsest step, an eighth to a quarter of the patch;
    Cancelled on request.
    """
    patch = appearance(tables)
    bounds = np.array(patch.shape[:2])
    levels = max(0, int(np.log2(bounds.min())) - _COARSEST)
    step = 1 << levels
    if size % (2 * step):
        raise NacreError(f"a map of {size} texels: expected a multiple of {2 * step}")
    coarse = size // step
    found = np.indices((coarse, coarse)).transpose(1, 2, 0) * step
    rng = np.random.default_rng(seed)
    moves = _likely_moves(patch, rng)
    # Squares that would show the same texels are moved differently, as far as there are moves.
    _, alike = np.unique(found % bounds @ (bounds[1], 1), return_inverse=True)
    for square in range(alike.max() + 1):
        y, x = np.nonzero(alike.reshape(coarse, coarse) == square)
        found[y, x] += moves[rng.permutation(np.arange(len(y)) % len(moves))]
        moves = rng.permutation(moves)
    found %= bounds
    for level in range(1, levels + 1):
        if progress is not None and not progress(level / (levels + 1), "Synthesizing"):
            raise Cancelled
        step = 1 << (levels - level)
        found = _doubled(found, step) % bounds
        vectors = _appearance_vectors(patch, step)
        alike = _most_alike(vectors, step)
        for _ in range(_PASSES):
            found = _corrected(found, vectors, alike, step)
    if progress is not None:
        progress(1.0, "Coordinates ready")
    return found.astype(np.uint16)


def _likely_moves(patch: Vectors, rng: np.random.Generator) -> Coordinates:
    """Translations (n, 2) that leave the patch most like itself, in any order: by its threads where
    it is woven, and any where it has no order that could be broken. None at all is one of them."""
    spectrum = np.abs(np.fft.rfft2(patch, axes=(0, 1))) ** 2
    likeness = np.fft.irfft2(spectrum.sum(2), s=patch.shape[:2])
    around = [np.roll(likeness, offset, (0, 1)) for offset in _AROUND.tolist()]
    peaks = likeness >= np.max(around, 0)
    peaks[0, 0] = False
    peaks &= likeness >= likeness[peaks].max(initial=0.0) - _STRICT * likeness[0, 0]
    peaks[0, 0] = True
    return rng.permutation(np.argwhere(peaks))


def appearance(tables: AnyTables) -> Vectors:
    """What each texel looks like in several lights and views, its principal components:
    (Y, X, numbers). Square roots keep highlights from counting for all."""
    values = np.sqrt(evaluate_pictures(tables, _LIGHTS, _VIEWS))
    height, width = values.shape[2:4]
    flat = values.transpose(2, 3, 0, 1, 4).reshape(height, width, -1)
    return _principal(flat, _NUMBERS)


def _principal(vectors: NDArray[np.floating], numbers: int) -> Vectors:
    """Vectors about their mean on their first principal axes."""
    flat = vectors.reshape(-1, vectors.shape[-1]).astype(np.float64)
    flat = flat - flat.mean(0)
    _, axes = np.linalg.eigh(flat.T @ flat)
    kept = flat @ axes[:, ::-1][:, :numbers]
    return kept.reshape(*vectors.shape[:2], -1).astype(np.float32)


def _appearance_vectors(patch: Vectors, step: int) -> Vectors:
    """A level's vectors: the 5 x 5 texels round each texel, and those of the patch as seen at the
    level's step, weighted by a Gaussian and reduced to principal components.

    Close texels say where in a thread a texel is, which no coarse step does.
    """
    close = [(patch, 1), (_blurred(patch, 0.5 * step), step)] if step > 1 else [(patch, 1)]
    parts = [
        np.exp(-(y**2 + x**2) / 4.0) * np.roll(seen, (-y * apart, -x * apart), (0, 1))
        for seen, apart in close
        for y in range(-2, 3)
        for x in range(-2, 3)
    ]
    return _principal(np.concatenate(parts, -1), _NUMBERS)


def _blurred(patch: Vectors, width: float) -> Vectors:
    """A periodic patch convolved with a Gaussian of a standard deviation in texels."""
    y, x = (np.fft.fftfreq(size) for size in patch.shape[:2])
    kernel = np.exp(-2.0 * (np.pi * width) ** 2 * (y[:, None] ** 2 + x**2))
    spectrum = np.fft.fft2(patch, axes=(0, 1)) * kernel[:, :, None]
    return np.fft.ifft2(spectrum, axes=(0, 1)).real.astype(np.float32)


def _most_alike(vectors: Vectors, step: int) -> Coordinates:
    """For each texel itself and the texels most like it, none of them close to another:
    (Y, X, _ALIKE, 2)."""
    height, width, _ = vectors.shape
    around = _neighbourhoods(vectors, step)
    flat = _principal(around.reshape(height, width, -1), _NUMBERS).reshape(height * width, -1)
    square = (flat**2).sum(1)
    y, x = np.divmod(np.arange(height * width), width)
    apart = max(1, round(_APART * min(height, width)))
    found = np.empty((height * width, _ALIKE), np.intp)
    found[:, 0] = np.arange(height * width)
    near = np.arange(-apart, apart + 1)
    chunk = max(1, (1 << 23) // len(flat))
    for first in range(0, len(flat), chunk):
        rows = np.arange(first, min(first + chunk, len(flat)))
        distances = square - 2.0 * flat[rows] @ flat.T
        for k in range(1, _ALIKE):
            last = found[rows, k - 1, None, None]
            close = (y[last] + near[:, None]) % height * width + (x[last] + near) % width
            np.put_along_axis(distances, close.reshape(len(rows), -1), np.inf, 1)
            found[rows, k] = distances.argmin(1)
    return np.stack(np.divmod(found, width), -1).reshape(height, width, _ALIKE, 2)


def _neighbourhoods(vectors: Vectors, step: int) -> Vectors:
    """The vectors on the diagonals of each texel, a level's step away: (Y, X, 4, numbers)."""
    return np.stack([np.roll(vectors, tuple(-d * step), (0, 1)) for d in _DIAGONALS], 2)


def _doubled(found: Coordinates, step: int) -> Coordinates:
    """Each coordinate becomes four, half a coarse step apart."""
    large = found.repeat(2, 0).repeat(2, 1)
    large[1::2, :, 0] += step
    large[:, 1::2, 1] += step
    return large


def _corrected(found: Coordinates, vectors: Vectors, alike: Coordinates, step: int) -> Coordinates:
    """One pass over a map's texels, a quarter of them at a time, so that each sees neighbours that
    are already corrected."""
    found = found.copy()
    size = found.shape[:2]
    bounds = np.array(vectors.shape[:2])
    width = vectors.shape[1]
    fits = _neighbourhoods(vectors, step).reshape(bounds.prod(), -1)
    flat = vectors.reshape(bounds.prod(), -1)
    # Coherent texels are preferred: they hold what is finer than the level.
    cost = np.tile([1.0, *[_INCOHERENT] * (alike.shape[2] - 1)], len(_AROUND)).astype(np.float32)
    for start in ((0, 0), (1, 1), (0, 1), (1, 0)):
        y, x = np.mgrid[start[0] : size[0] : 2, start[1] : size[1] : 2]
        grid = np.stack([y.ravel(), x.ravel()], 1)

        def at(offsets: NDArray[np.intp], grid: Coordinates = grid) -> Coordinates:
            y, x = np.moveaxis((grid[:, None] + offsets) % size, -1, 0)
            return found[y, x]

        # What stands on the diagonals: three neighbours of each say what it should be.
        seen = []
        for diagonal in _DIAGONALS:
            more = diagonal * [(0, 0), (1, 0), (0, 1)]
            places = (at(diagonal + more) - more * step) % bounds
            seen.append(flat[places @ (width, 1)].mean(1))
        around = np.concatenate(seen, 1)
        y, x = np.moveaxis(at(_AROUND), -1, 0)
        candidates = (alike[y, x] - _AROUND[:, None] * step) % bounds
        candidates = candidates.reshape(len(grid), -1, 2)
        errors = ((fits[candidates @ (width, 1)] - around[:, None]) ** 2).sum(2) * cost
        best = candidates[np.arange(len(grid)), errors.argmin(1)]
        found[grid[:, 0], grid[:, 1]] = best
    return found
