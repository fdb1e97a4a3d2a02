"""How far samples are from others: the measures of the tensor papers."""

from __future__ import annotations

from collections.abc import Iterable
from math import isfinite, log10

import numpy as np
from numpy.typing import NDArray

from ..errors import NacreError


def compare_blocks(
    pairs: Iterable[tuple[NDArray[np.floating], NDArray[np.floating]]], peak: float | None = None
) -> dict[str, float | None]:
    """Compare reference blocks with approximations of the same shapes, one pair at a time.

    Returns snr_db = 10 log10(sum A^2 / sum (A - B)^2), psnr_db against `peak` (max |A| when None),
    mse and max_abs. A ratio is None where it is infinite, as JSON has no infinity. Raises
    NacreError for values that are not finite.
    """
    energy = error = largest = highest = 0.0
    count = 0
    for a, b in pairs:
        # Half floats become double ones several times faster by way of single ones.
        reference = np.asarray(a, np.result_type(a, np.float32)).astype(np.float64)
        with np.errstate(invalid="ignore"):  # of infinities, which are refused below
            difference = reference - b
        energy += float(np.vdot(reference, reference))
        error += float(np.vdot(difference, difference))
        highest = max(highest, _peak(reference))
        largest = max(largest, _peak(difference))
        count += reference.size
    if not isfinite(energy + error):
        raise NacreError("cannot compare values that are not finite numbers")
    mse = error / max(count, 1)
    top = highest if peak is None else peak
    return {
        "snr_db": _decibels(energy, error),
        "psnr_db": _decibels(top**2, mse),
        "mse": mse,
        "max_abs": largest,
    }


def beyond_noise(snr_db: float | None, noise_floor_db: float | None) -> str:
    """One line for an approximation closer to the samples than their own noise; else nothing."""
    if snr_db is None or noise_floor_db is None or snr_db <= noise_floor_db:
        return ""
    return (
        f"{snr_db:.1f} dB is beyond the samples' noise floor of {noise_floor_db:.1f} dB: what is "
        "kept between is noise"
    )


def _peak(values: NDArray[np.float64]) -> float:
    return max(float(values.max(initial=0.0)), -float(values.min(initial=0.0)))


def _decibels(signal: float, noise: float) -> float | None:
    return 10.0 * log10(signal / noise) if signal > 0.0 and noise > 0.0 else None
