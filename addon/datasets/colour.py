"""Colours to linear Rec.709, where a white diffuser is (1, 1, 1)."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

# Chromaticities x, y of ITU-R BT.709: red, green, blue, and the white D65.
_PRIMARIES = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))
_WHITE = (0.3127, 0.3290)
# Columns nm, x, y, z, d65; made by tools/colour_tables.py.
_TABLE = Path(__file__).with_name("cie_1931_d65.csv")


def srgb_to_linear(encoded: ArrayLike) -> np.ndarray:
    """Linear values of sRGB ones (IEC 61966-2-1); those below 0 are 0."""
    value = np.maximum(np.asarray(encoded, np.float64), 0.0)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def xyz_to_rec709() -> np.ndarray:
    """The matrix (3, 3) from CIE XYZ to linear Rec.709; D65 with Y = 1 becomes (1, 1, 1)."""
    primaries = np.stack([_xyz(*primary) for primary in _PRIMARIES], axis=1)
    scale = np.linalg.solve(primaries, _xyz(*_WHITE))
    return np.linalg.inv(primaries * scale)


def spectrum_to_rec709(wavelengths: Sequence[float]) -> np.ndarray:
    """The matrix (3, n) from a reflectance spectrum, at n ascending wavelengths in nm, to Rec.709.

    The spectrum, seen under D65 by the CIE 1931 observer, is linear between its wavelengths and
    constant beyond their ends. One that is 1 everywhere becomes (1, 1, 1) exactly.
    """
    with _TABLE.open(encoding="ascii") as file:
        next(rows := csv.reader(file))
        table = np.array([[float(cell) for cell in row] for row in rows])
    nm, observer, d65 = table[:, 0], table[:, 1:4], table[:, 4]
    hats = np.stack([np.interp(nm, wavelengths, row) for row in np.eye(len(wavelengths))])
    weights = xyz_to_rec709() @ (hats @ (observer * d65[:, None])).T
    return weights / weights.sum(axis=1, keepdims=True)


def _xyz(x: float, y: float) -> np.ndarray:
    return np.array([x / y, 1.0, (1.0 - x - y) / y])
