"""Named sets of directions: those that laboratories measure at, even ones, and one's own."""

import math

import numpy as np

from ..errors import NacreError
from .directions import read_directions_csv, spherical_to_unit

# Rings: (theta in degrees, directions evenly spaced in azimuth, phi of the first in degrees).
_Rings = tuple[tuple[float, int, float], ...]

# The 81 directions of the University of Bonn's BTFs of 2003, in the order of its files; UTIA
# measures at the same.
_UBO_81: _Rings = ((0, 1, 0), (15, 6, 0), (30, 12, 0), (45, 18, 0), (60, 20, 0), (75, 24, 0))
# The 151 directions of Bonn's BTFs of 2014.
_UBO_151: _Rings = (
    (0, 1, 0),
    (11, 6, 15),
    (23.5, 12, 0),
    (30, 12, 15),
    (37.5, 12, 0),
    (45, 18, 0),
    (52.5, 18, 7.5),
    (60, 24, 0),
    (67.5, 24, 7.5),
    (75, 24, 0),
)
_RINGS = {"ubo81": _UBO_81, "utia": _UBO_81, "ubo151": _UBO_151}

NAMES = (*_RINGS, "uniform:N")
"""What `direction_set` knows by name; N is a number."""

MOST = 4096
"""As many directions as an evenly spaced set may have."""

# Evenly spaced sets end here: at the horizon there is nothing to see.
_UNIFORM_END = 80.0


def direction_set(name: str) -> np.ndarray:
    """Unit vectors (n, 3) float64 of a named set, or of a CSV file (see `read_directions_csv`).

    Names are ubo81, ubo151, utia and uniform:N, N directions at even distances down to 80 degrees.
    Raises NacreError for an unknown name and for anything wrong with the file.
    """
    if name in _RINGS:
        return _from_rings(_RINGS[name])
    kind, _, count = name.partition(":")
    if kind == "uniform":
        if not (count.isascii() and count.isdigit() and 1 <= int(count) <= MOST):
            raise NacreError(f"directions {name!r}: expected uniform:N with N from 1 to {MOST}")
        return uniform(int(count))
    if not name.lower().endswith(".csv"):
        known = ", ".join(NAMES)
        raise NacreError(f"directions {name!r}: expected one of {known} or a .csv file")
    return read_directions_csv(name)


def ubo_81() -> np.ndarray:
    """Unit vectors (81, 3) float64."""
    return _from_rings(_UBO_81)


def uniform(count: int) -> np.ndarray:
    """Unit vectors (count, 3) float64 at even distances; the first is the normal.

    A spiral whose turns are a golden angle apart, each direction with as much of the solid angle
    (Vogel 1979).
    """
    end = math.cos(math.radians(_UNIFORM_END))
    number = np.arange(count)
    z = 1.0 - (1.0 - end) * number / max(count - 0.5, 1.0)
    phi = number * math.pi * (3.0 - math.sqrt(5.0))
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(phi), across * np.sin(phi), z], -1)


def _from_rings(rings: _Rings) -> np.ndarray:
    angles = [(theta, phi + 360.0 * i / n) for theta, n, phi in rings for i in range(n)]
    theta, phi = zip(*angles, strict=True)
    return spherical_to_unit(theta, phi)
