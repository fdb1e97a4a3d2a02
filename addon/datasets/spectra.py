"""Spectra to colours: what each wavelength adds to linear Rec.709."""

import csv
from functools import cache
from pathlib import Path

import numpy as np

_TABLE = Path(__file__).with_name("cie_1931_d65.csv")
# ITU-R BT.709: XYZ of red, green and blue in the columns, for D65 of Y = 1.
_PRIMARIES = np.array([[0.64, 0.30, 0.15], [0.33, 0.60, 0.06], [0.03, 0.10, 0.79]])


def spectrum_to_rgb(wavelengths: np.ndarray) -> np.ndarray:
    """What makes linear Rec.709 of reflectances at increasing wavelengths (n,) in nm: (3, n).

    Reflectances are linear between wavelengths and constant beyond the first and the last, seen
    under D65 by the CIE's observer of 1931. A reflectance of 1 everywhere is white, (1, 1, 1).
    """
    nm, observer, illuminant = _table()
    hats = np.stack([np.interp(nm, wavelengths, row) for row in np.eye(len(wavelengths))])
    xyz = (observer * illuminant) @ hats.T
    white = xyz.sum(1)
    to_xyz = _PRIMARIES * np.linalg.solve(_PRIMARIES, white)
    return np.linalg.solve(to_xyz, xyz)


@cache
def _table() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    with _TABLE.open(newline="") as file:
        rows = np.array(list(csv.reader(file))[1:], np.float64)
    return rows[:, 0], rows[:, 1:4].T, rows[:, 4]
