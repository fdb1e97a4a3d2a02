"""The domain that colours are fitted in: linear, or log luminance with chroma relative to it.

In the logarithmic one equal errors look about equal, bright or dark. It is colour model 11 of
UBO2014's files but for the offset: a hundredth of white, below which lightness (CIE L*) is linear
and measured values are mostly noise, which a smaller offset would spend the ranks on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..datasets.dataset import Dataset
from ..errors import NacreError

DOMAINS = ("linear", "log")

OFFSET = np.float32(0.01)
"""Added to luminance before the logarithm: part of the file format, and in nacre_native too."""

TO_YUV = np.array([[0.299, 0.587, 0.114], [-0.14713, -0.28886, 0.436], [0.615, -0.51499, -0.10001]])
TO_RGB = np.linalg.inv(TO_YUV)


def to_log(rgb: NDArray[np.floating]) -> NDArray[np.float32]:
    """log(Y + offset), U / (Y + offset), V / (Y + offset) of linear colours (..., 3), Y at least 0.

    What nacre_native does with samples as it reads them for a fit.
    """
    yuv = rgb @ TO_YUV.T
    luminance = np.maximum(yuv[..., :1], 0.0) + OFFSET
    return np.concatenate([np.log(luminance), yuv[..., 1:] / luminance], -1).astype(np.float32)


def to_linear(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """The linear colours (..., 3) of what `to_log` returns; not clamped."""
    luminance = np.exp(values[..., :1])
    yuv = np.concatenate([luminance - OFFSET, values[..., 1:] * luminance], -1)
    return np.asarray(yuv @ TO_RGB.T.astype(np.float32), np.float32)


def check_domain(domain: str, dataset: Dataset) -> None:
    """Raise NacreError for a domain that a dataset cannot be fitted in."""
    if domain not in DOMAINS:
        raise NacreError(f"domain {domain!r}: expected one of {', '.join(DOMAINS)}")
    if domain == "log" and (dataset.kind != "btf" or [*dataset.channels] != ["R", "G", "B"]):
        raise NacreError(f"domain log: {dataset.path.name} is not of the channels R, G, B")
