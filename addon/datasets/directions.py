"""Directions on the hemisphere above a surface: angles, unit vectors and lists in CSV files.

The frame is x = tangent, y = bitangent, z = normal. theta is the angle from the normal and phi the
azimuth, counter-clockwise from +x; both are in degrees.
"""

import csv
import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..errors import NacreError

# Angles that were rounded on their way through a file may pass the horizon by this many degrees.
HORIZON_TOLERANCE = 0.01


def spherical_to_unit(theta_deg: ArrayLike, phi_deg: ArrayLike) -> np.ndarray:
    """Unit vectors (n, 3) float64 from polar angles and azimuths in degrees, each (n,)."""
    theta = np.radians(np.atleast_1d(np.asarray(theta_deg, np.float64)))
    phi = np.radians(np.atleast_1d(np.asarray(phi_deg, np.float64)))
    return np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1
    )


def unit_to_spherical(directions: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """(theta, phi) in degrees, each (n,), of directions (n, 3); phi lies in [0, 360)."""
    x, y, z = np.asarray(directions, np.float64).T
    theta = np.degrees(np.arctan2(np.hypot(x, y), z))
    phi = np.degrees(np.arctan2(y, x)) % 360.0
    # A tiny negative angle modulo 360 rounds up to 360 itself.
    return theta, np.where(phi >= 360.0, 0.0, phi)


def is_above_horizon(theta_deg: ArrayLike) -> np.bool_ | np.ndarray:
    """Whether polar angles, possibly negative, point away from the surface."""
    return np.abs(np.asarray(theta_deg)) <= 90.0 + HORIZON_TOLERANCE


def read_directions_csv(path: str | Path) -> np.ndarray:
    """Unit vectors (n, 3) from a CSV file with the header `theta,phi`, in degrees.

    Raises NacreError, with the line number, for a missing or different header, a line that is not
    two finite numbers, a direction below the surface, and a file without directions.
    """
    path = Path(path)
    angles: list[tuple[float, float]] = []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = csv.reader(file)
            header = next(rows, [])
            if [cell.strip().lower() for cell in header] != ["theta", "phi"]:
                raise NacreError(f"{path.name}, line 1: expected the header theta,phi")
            for row in rows:
                if any(cell.strip() for cell in row):
                    angles.append(_parse_row(row, f"{path.name}, line {rows.line_num}"))
    except OSError as error:
        raise NacreError(f"cannot read {path}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise NacreError(f"{path.name} is not a CSV text file: {error}") from error
    if not angles:
        raise NacreError(f"{path.name} holds no directions: add one theta,phi pair a line")
    theta, phi = zip(*angles, strict=True)
    return spherical_to_unit(theta, phi)


def _parse_row(row: list[str], place: str) -> tuple[float, float]:
    try:
        theta, phi = (float(cell) for cell in row)
    except ValueError:
        text = ",".join(row)
        raise NacreError(f"{place}: expected two numbers, theta,phi, found {text!r}") from None
    if not (math.isfinite(theta) and math.isfinite(phi)):
        raise NacreError(f"{place}: the angles must be finite numbers")
    if not is_above_horizon(theta):
        raise NacreError(f"{place}: theta {theta:g} points below the surface (at most 90 degrees)")
    return theta, phi
