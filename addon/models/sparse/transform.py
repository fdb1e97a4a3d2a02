"""What is coded: Y, U and V of log(1 + RGB / offset), less the means of its images (SparseBTF,
Section 3.1).

The smaller the offset, the more a coefficient cares for how things look in the dark, and the less
for the values of highlights: far above all values the logarithm is linear, and what is coded are
the values themselves. The paper's log(RGB + offset) differs by a constant, which its means take up.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...datasets.dataset import Dataset
from ...errors import Cancelled, NacreError
from ..domain import TO_RGB, TO_YUV

CHANNELS = "YUV"

OFFSET = 8.0
"""Nearly linear: the least squared error of values. 0.1 keeps more of what is seen, at more than
twice the squared error on glossy materials; the authors' 1e-5 spends the coefficients on what lies
far below a hundredth of white (docs/sparse.md)."""

OFFSETS = (1e-6, 1e3)
"""The least and the largest: beyond them single precision does not tell values apart."""

MOST = 11.0
"""The logarithm of the largest colour that comes back."""

_BLOCK = 2**22  # values in memory at a time
_LEAST = 1e-6  # deviation of an image that is one colour all over


@dataclass(frozen=True)
class Normalisation:
    """Means (light, view, 3) float32 of each image in Y, U and V, what these are divided by (light,
    view), and the logarithm's offset.

    The authors take one mean of Y, U and V together and divide by their deviation from it. Ours are
    not divided: a coefficient then counts as much in each image, and as much as the values do.
    """

    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    offset: float

    def code(self, rgb: NDArray[np.floating]) -> NDArray[np.float32]:
        """Linear colours (light, view, ..., 3) as Y, U, V less their mean, over deviation."""
        values = to_log_yuv(rgb, self.offset)
        values -= _spread(self.mean, values)
        values /= _spread(self.deviation, values)
        return values

    def logarithms(
        self, values: NDArray[np.float32], light: NDArray[np.intp], view: NDArray[np.intp]
    ) -> NDArray[np.float32]:
        """Y, U, V of the logarithm that are behind normalised ones."""
        part = np.ix_(light, view)
        values = values * _spread(self.deviation[part], values)
        values += _spread(self.mean[part], values)
        return values


def to_log_yuv(rgb: NDArray[np.floating], offset: float) -> NDArray[np.float32]:
    """Y, U, V of log(1 + RGB / offset) of colours (..., 3); what is below 0 counts as 0."""
    logarithm = np.log1p(np.maximum(rgb, 0.0, dtype=np.float32) / np.float32(offset))
    return np.asarray(logarithm @ TO_YUV.T.astype(np.float32), np.float32)


def to_linear_rgb(values: NDArray[np.float32], offset: float) -> NDArray[np.float32]:
    """The linear colours (..., 3) of what `to_log_yuv` returns."""
    logarithm = values @ TO_RGB.T.astype(np.float32)
    # A few coefficients may shoot far over what was ever measured: never to infinity.
    limit = np.float32(MOST - np.log(offset))
    return np.asarray(np.expm1(np.minimum(logarithm, limit)) * np.float32(offset), np.float32)


def normalisation(
    dataset: Dataset,
    offset: float,
    by_deviation: bool = False,
    progress: Callable[[float, str], bool] | None = None,
) -> Normalisation:
    """Read a dataset once, for the authors' normalisation or ours (`Normalisation`).

    NacreError for other colours than R, G, B, Cancelled on request."""
    if dataset.kind != "btf" or [*dataset.channels] != ["R", "G", "B"]:
        raise NacreError(f"{dataset.path.name}: sparse codes are of a BTF of R, G, B")
    lights, views, height, width, _ = dataset.shape
    most = max(1, _BLOCK // (3 * height * width))
    mean = np.empty((lights, views, 3), np.float32)
    deviation = np.ones((lights, views), np.float32)
    for light in range(lights):
        if progress is not None and not progress(light / lights, "Reading samples"):
            raise Cancelled
        for first in range(0, views, most):
            some = slice(first, first + most)
            values = to_log_yuv(dataset.samples[light, some], offset)
            if not np.isfinite(values).all():
                raise NacreError(
                    f"{dataset.path.name}: light {light} has values that are not finite"
                )
            whole = values.reshape(len(values), -1)
            if by_deviation:
                mean[light, some] = whole.mean(1, dtype=np.float64)[:, None]
                deviation[light, some] = whole.std(1, dtype=np.float64)
            else:
                mean[light, some] = values.mean((1, 2), dtype=np.float64)
    return Normalisation(mean, np.maximum(deviation, np.float32(_LEAST)), offset)


def _spread(images: NDArray[np.float32], values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Numbers (light, view) or (light, view, 3) of images as they go with values (light, view, ...,
    3)."""
    channels = images.shape[2:] or (1,)
    return images.reshape(*images.shape[:2], *(1,) * (values.ndim - 3), *channels)
