"""What is coded: Y, U, V of log RGB, each image normalised (SparseBTF, Section 3.1)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...datasets.dataset import Dataset
from ...errors import Cancelled, NacreError
from ..domain import TO_RGB, TO_YUV

CHANNELS = "YUV"

OFFSET = 0.01
"""Added before the logarithm. The authors' ensembles take 1e-5, which spends the coefficients on
what lies below a hundredth of white: on noise, where values were rendered (docs/sparse.md)."""

_BLOCK = 2**22  # values in memory at a time
_LEAST = 1e-6  # deviation of an image that is one colour all over


@dataclass(frozen=True)
class Normalisation:
    """Mean and standard deviation (light, view) float32 of each image, over its texels and over Y,
    U and V together, as the authors take them; offset is that of the logarithm."""

    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    offset: float

    def code(self, rgb: NDArray[np.floating]) -> NDArray[np.float32]:
        """Linear colours (light, view, ..., 3) as Y, U, V of equal mean and deviation."""
        values = to_log_yuv(rgb, self.offset)
        values -= _spread(self.mean, values)
        values /= _spread(self.deviation, values)
        return values

    def decode(
        self, values: NDArray[np.float32], light: NDArray[np.intp], view: NDArray[np.intp]
    ) -> NDArray[np.float32]:
        """Linear colours of normalised Y, U, V (lights, views, ..., 3) of some lights and views."""
        return to_linear_rgb(self.logarithms(values, light, view), self.offset)

    def logarithms(
        self, values: NDArray[np.float32], light: NDArray[np.intp], view: NDArray[np.intp]
    ) -> NDArray[np.float32]:
        """Y, U, V of the logarithm that are behind normalised ones."""
        part = np.ix_(light, view)
        values = values * _spread(self.deviation[part], values)
        values += _spread(self.mean[part], values)
        return values


def to_log_yuv(rgb: NDArray[np.floating], offset: float) -> NDArray[np.float32]:
    """Y, U, V of log(RGB + offset) of colours (..., 3); what is below 0 counts as 0."""
    logarithm = np.log(np.maximum(rgb, 0.0, dtype=np.float32) + np.float32(offset))
    return np.asarray(logarithm @ TO_YUV.T.astype(np.float32), np.float32)


def to_linear_rgb(values: NDArray[np.float32], offset: float) -> NDArray[np.float32]:
    """The linear colours (..., 3) of what `to_log_yuv` returns."""
    logarithm = values @ TO_RGB.T.astype(np.float32)
    # A few coefficients may shoot far over what was ever measured: never to infinity.
    return np.asarray(np.exp(np.minimum(logarithm, 11.0)) - np.float32(offset), np.float32)


def normalisation(
    dataset: Dataset, offset: float, progress: Callable[[float, str], bool] | None = None
) -> Normalisation:
    """Read a dataset once; NacreError for other colours than R, G, B, Cancelled on request."""
    if dataset.kind != "btf" or [*dataset.channels] != ["R", "G", "B"]:
        raise NacreError(f"{dataset.path.name}: sparse codes are of a BTF of R, G, B")
    lights, views, height, width, _ = dataset.shape
    most = max(1, _BLOCK // (3 * height * width))
    mean, deviation = (np.empty((lights, views), np.float32) for _ in range(2))
    for light in range(lights):
        if progress is not None and not progress(light / lights, "Reading samples"):
            raise Cancelled
        for first in range(0, views, most):
            some = slice(first, first + most)
            values = to_log_yuv(dataset.samples[light, some], offset)
            values = values.reshape(len(values), -1)
            if not np.isfinite(values).all():
                raise NacreError(
                    f"{dataset.path.name}: light {light} has values that are not finite"
                )
            mean[light, some] = values.mean(1, dtype=np.float64)
            deviation[light, some] = values.std(1, dtype=np.float64)
    return Normalisation(mean, np.maximum(deviation, np.float32(_LEAST)), offset)


def _spread(images: NDArray[np.float32], values: NDArray[np.float32]) -> NDArray[np.float32]:
    return images.reshape(*images.shape, *(1,) * (values.ndim - 2))
