"""How many bits each stored number needs: rounding that a lossless file then turns into size.

A fit's own error hides errors far below it. Numbers are rounded to multiples of steps that are
powers of two of their array's peak, so that nearly all are half floats that end in zeros.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .clustered_tucker import ClusteredTucker

SHARE = 3e-5
"""Rounding may add this share of the fit's squared error: 0.0001 dB."""


def round_model(
    model: ClusteredTucker, squared_error: float, share: float = SHARE
) -> ClusteredTucker:
    """Round the core and the bases so that each number adds about as much error as any other.

    `squared_error` is the fit's, sum (A - A^)^2, and rounding may add `share` of it. Bases are
    orthonormal, so an error in the core passes to the samples as it is, and one in a basis column
    times the norm of the core's slice.
    """
    count = model.core.size + sum(basis.size for basis in model.bases.values())
    if squared_error <= 0.0:
        return model
    step = float(np.sqrt(12.0 * share * squared_error / count))
    bases = {}
    for number, mode in enumerate(model.modes, start=1):
        basis = model.bases[mode]
        others = tuple(axis for axis in range(1, model.core.ndim) if axis != number)
        slices = np.sqrt(np.sum(np.square(model.core, dtype=float), axis=others))
        if mode in model.members:  # each number goes with the core of its cluster
            gain = slices[model.core_of(mode)]
        elif len(basis) == len(slices):
            gain = slices[:, None, None]
        else:  # global: with all of them
            gain = np.linalg.norm(slices, axis=0)[None, None, None]
        steps = step / np.maximum(gain, 1e-30)
        bases[mode] = _round(basis, np.broadcast_to(steps, basis.shape))
    core = _round(model.core, np.full(model.core.shape, step))
    return replace(model, core=core, bases=bases)


def _round(values: NDArray[np.float32], steps: NDArray[np.float64]) -> NDArray[np.float32]:
    """Round to powers of two of the peak: the larger one on just so many rows, spread evenly, that
    the mean squared step is the wanted one. A single power would miss it by up to four times."""
    peak = float(np.abs(values).max(initial=0.0))
    if peak == 0.0:
        return values
    wanted = steps / peak
    small = np.exp2(np.floor(np.log2(wanted)))
    larger = ((wanted / small) ** 2 - 1.0) / 3.0  # the share that takes twice the small step
    row = np.arange(values.size // values.shape[-1]).reshape(*values.shape[:-1], 1)
    golden = 0.6180339887498949  # multiples of it modulo 1 fill the unit interval evenly
    chosen = peak * np.where(row * golden % 1.0 < larger, 2.0 * small, small)
    # A step beyond the peak would drop the number altogether.
    chosen = np.minimum(chosen, peak / 8.0)
    return (np.round(values / chosen) * chosen).astype(np.float32)
