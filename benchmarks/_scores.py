"""How much two pictures differ: PSNR, SSIM and FLIP, of sRGB values in [0, 1]."""

from __future__ import annotations

from typing import Any

import flip_evaluator
import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.float32]


def srgb(linear: Pixels) -> Pixels:
    """As shown: sRGB in [0, 1], top row first."""
    value = np.clip(linear[::-1], 0.0, 1.0)
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)


def score(truth: Pixels, seen: Pixels, mask: NDArray[np.bool_] | None = None) -> dict[str, Any]:
    """PSNR in dB, the mean FLIP error and its map in colours, and SSIM (Wang et al. 2004, with its
    Gaussian window), over the mask's pixels or all, of two sRGB pictures (y, x, 3)."""
    from skimage.metrics import structural_similarity

    reference, test = (np.ascontiguousarray(p, np.float32) for p in (truth, seen))
    if mask is None:
        mask = np.ones(reference.shape[:2], bool)
    colours, _, _ = flip_evaluator.evaluate(reference, test, "LDR")
    errors, _, _ = flip_evaluator.evaluate(reference, test, "LDR", applyMagma=False)
    _, similar = structural_similarity(
        reference, test, channel_axis=2, data_range=1.0, full=True,
        gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
    )  # fmt: skip
    return {
        "PSNR": float(-10 * np.log10(np.square(reference - test)[mask].mean())),
        "SSIM": float(similar[mask].mean()),
        "FLIP": float(errors[mask].mean()),
        "map": colours,
    }
