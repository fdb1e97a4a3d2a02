"""MERL `.binary` files: isotropic BRDFs in coordinates of half and difference vector.

Matusik et al., "A Data-Driven Reflectance Model", 2003. Three int32, the cells of theta_h, theta_d
and phi_d, then a table of doubles for each of red, green and blue, phi_d fastest. Cells of theta_h
are finer near the normal: number 90 sqrt(theta_h / 90 degrees). There are 180 cells of phi_d, half
a turn, for a reciprocal BRDF, and 360, the whole turn, for one that is not (LIRIS' collection of
models fitted to the database). A value is that of its cell, as in the database's own code.
"""

import math
import struct
from functools import partial
from pathlib import Path

import numpy as np

from ..errors import NacreError
from .brdf.uniform import OPTIONS as OPTIONS
from .brdf.uniform import Evaluate, half_difference, uniform_source
from .options import Options
from .source import Source

FORMAT = "merl"
EXTENSIONS = (".binary",)

_SHAPES = {(90, 90, 180): math.pi, (90, 90, 360): 2 * math.pi}
"""Cells of theta_h, theta_d and phi_d: the range of phi_d."""

_HEADER = struct.Struct("<3i")
# f_r in 1/sr of a stored 1, of red, green and blue.
_SCALE = np.array([1.0, 1.15, 1.66]) / 1500.0
# Directions exactly on the border of two cells belong to the upper one, whatever rounding says.
_BORDER = 1e-6


def matches(path: Path) -> bool:
    """Whether the file begins with the cells of such a table and is as long as it."""
    try:
        with path.open("rb") as file:
            shape = _shape(file.read(_HEADER.size))
        return shape in _SHAPES and path.stat().st_size == _size(shape)
    except OSError:
        return False


def open_source(path: Path, options: Options) -> Source:
    """Read the header, check the file's size and count the values that are invalid.

    Raises NacreError for another table than 90 x 90 x 180 or 90 x 90 x 360 cells, and for another
    size than it needs.
    """
    try:
        with path.open("rb") as file:
            shape = _shape(file.read(_HEADER.size))
        size = path.stat().st_size
    except OSError as error:
        raise NacreError(f"cannot read {path}: {error.strerror}") from error
    if shape not in _SHAPES:
        found = "is cut short" if shape is None else f"claims {_text(shape)} cells"
        known = " or ".join(map(_text, _SHAPES))
        raise NacreError(f"{path.name} is not a MERL BRDF: its header {found}; expected {known}")
    if size != _size(shape):
        raise NacreError(
            f"{path.name} is {'cut short' if size < _size(shape) else 'damaged'}: {_text(shape)} "
            f"cells take {_size(shape)} bytes, it has {size}"
        )
    with np.errstate(invalid="ignore"):
        invalid = sum(int(np.count_nonzero(~(plane >= 0.0))) for plane in _map(path, shape))
    total = 3 * math.prod(shape)
    conversions = [
        "f_r = stored value x 1, 1.15, 1.66 / 1500 of red, green, blue, taken as linear Rec.709; "
        "multiplied by pi cos(theta_light)"
    ]
    if invalid:
        conversions.append(f"{invalid} of {total} values are negative, that is invalid: taken as 0")
    return uniform_source(
        path,
        FORMAT,
        options,
        size,
        conversions,
        {"cells": list(shape), "reciprocal": _SHAPES[shape] == math.pi},
        0,  # the tables are mapped
        partial(_load, path, shape),
    )


def _text(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))


def _shape(header: bytes) -> tuple[int, int, int] | None:
    return _HEADER.unpack(header) if len(header) == _HEADER.size else None


def _size(shape: tuple[int, int, int]) -> int:
    return _HEADER.size + 3 * 8 * math.prod(shape)


def _map(path: Path, shape: tuple[int, int, int]) -> np.ndarray:
    """The tables (channel, theta_h, theta_d, phi_d), mapped."""
    return np.memmap(path, dtype="<f8", mode="r", offset=_HEADER.size, shape=(3, *shape))


def _load(path: Path, shape: tuple[int, int, int]) -> Evaluate:
    red, green, blue = _map(path, shape)

    def evaluate(light: np.ndarray, view: np.ndarray) -> np.ndarray:
        half, difference, phi = half_difference(light, view)
        turn = _SHAPES[shape]
        parts = (np.sqrt(half / (0.5 * np.pi)), difference / (0.5 * np.pi), (phi % turn) / turn)
        cells = tuple(
            np.minimum((part * count + _BORDER).astype(np.intp), count - 1)
            for part, count in zip(parts, shape, strict=True)
        )
        stored = np.stack([plane[cells] for plane in (red, green, blue)], -1)
        valid = np.where(stored >= 0.0, stored, 0.0)  # NaN is invalid too
        return valid * (_SCALE * np.pi * light[:, 2:])

    return evaluate
