"""The colour spaces that DFMF decorrelates its channels in, back to linear ones.

The definition is btflib's `undecorrelate`. Its Lab goes to gamma-encoded sRGB; here Lab goes to the
same colours, linear and not clipped.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...errors import NacreError

NAMES = {
    0: "RGB",
    1: "YUV",
    2: "Lab",
    3: "PCA",
    4: "YCoCg",
    5: "spectral",
    6: "spectral linear",
    9: "log Y, U, V",
    10: "log Y, signed log U, V",
    11: "log Y, U/Y, V/Y",
    12: "log RGB",
}
LOG_OFFSET = np.float32(1e-5)

# Models whose result is the channels that the header names, however many; the others' is RGB.
_NAMED = {0, 3, 5, 6, 12}
_ANY_COUNT = {0, 5, 6, 12}

YUV_TO_RGB = ((1.0, 0.0, 1.13983), (1.0, -0.39465, -0.5806), (1.0, 2.03211, 0.0))
_YCOCG_TO_RGB = ((1.0, 1.0, -1.0), (1.0, 0.0, 1.0), (1.0, -1.0, -1.0))
# Lab's white is D50 (ICC); Bradford's adaptation to D65 and the primaries of Rec.709 are in it.
_D50 = (0.9642, 1.0, 0.8249)
_XYZ_D50_TO_RGB = (
    (3.1337826, -1.6168778, -0.4906235),
    (-0.9787618, 1.9161365, 0.0334412),
    (0.0719670, -0.2290271, 1.4057905),
)


@dataclass(frozen=True)
class ColourModel:
    """A model's number; mean (3,) and matrix (3, 3), rows of the file, are the PCA's."""

    number: int
    mean: np.ndarray
    matrix: np.ndarray

    @property
    def label(self) -> str:
        return f"{self.number} ({NAMES[self.number]})"

    @property
    def named(self) -> bool:
        return self.number in _NAMED

    def check(self, name: str, channels: int) -> None:
        """Raise NacreError for a model that is unknown or not for so many channels."""
        if self.number not in NAMES:
            known = ", ".join(f"{number} {label}" for number, label in NAMES.items())
            raise NacreError(
                f"{name} has the unknown colour model {self.number}; known are: {known}"
            )
        if channels != 3 and self.number not in _ANY_COUNT:
            raise NacreError(
                f"{name} has {channels} colour channels, but the colour model {self.label} is one "
                "of three"
            )
        if self.number == 3 and not np.isfinite([*self.mean, *self.matrix.flat]).all():
            raise NacreError(f"{name} is damaged: the PCA's mean and matrix are not finite numbers")

    def decode(self, planes: np.ndarray) -> np.ndarray:
        """Stored channels (channel, ...) float32 to linear ones; may reuse the array."""
        match self.number:
            case 0:
                return planes
            case 1:
                return _transformed(YUV_TO_RGB, planes)
            case 2:
                return _lab_to_rgb(planes)
            case 3:
                result = _transformed(self.matrix.T, planes)
                result += self.mean.astype(np.float32).reshape(3, *[1] * (planes.ndim - 1))
                return result
            case 4:
                return _transformed(_YCOCG_TO_RGB, planes)
            case 5:
                return _spectral(planes)
            case 6:
                return _spectral_linear(planes)
            case 12:
                return np.exp(planes, out=planes) - LOG_OFFSET
        y, u, v = planes
        np.exp(y, out=y)
        if self.number == 10:
            for chroma in (u, v):
                np.copysign(np.exp(np.abs(chroma)) * LOG_OFFSET, chroma, out=chroma)
        if self.number == 11:
            # The chroma was divided by Y + offset, which is what the exponential gives.
            u *= y
            v *= y
        y -= LOG_OFFSET
        return _transformed(YUV_TO_RGB, planes)


def _transformed(rows: ArrayLike, planes: np.ndarray) -> np.ndarray:
    """Each result is a sum of the planes with the weights of a row."""
    return np.tensordot(np.asarray(rows, np.float32), planes, 1)


def _lab_to_rgb(planes: np.ndarray) -> np.ndarray:
    """L in 0..100 and a, b to linear RGB (CIE 1976)."""
    lightness, a, b = planes
    fy = (lightness + 16) / 116
    curved = np.stack([fy + a / 500, fy, fy - b / 200])
    xyz = np.where(curved > 6 / 29, curved**3, (curved - 4 / 29) * (3 * (6 / 29) ** 2))
    xyz *= np.array(_D50, np.float32).reshape(3, *[1] * (planes.ndim - 1))
    return _transformed(_XYZ_D50_TO_RGB, xyz)


def _spectral(planes: np.ndarray) -> np.ndarray:
    """The channels' sum first, then the fractions that all but the first channel have of it."""
    total = planes[0].copy()
    planes[0] = 1 - planes[1:].sum(0)
    planes *= total
    return planes


def _spectral_linear(planes: np.ndarray) -> np.ndarray:
    """The channels' mean first, then differences from their sum, in units of it.

    The first channel is btflib's to the letter, which takes the others' stored differences from it
    although those have no unit.
    """
    count = len(planes)
    total = planes[0] * np.float32(count)
    planes[0] = total - planes[1:].sum(0) / np.float32(count)
    planes[1:] *= total
    planes[1:] += total
    return planes
