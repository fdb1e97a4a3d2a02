"""The decoded channels of a file to red, green and blue."""

import re
from collections.abc import Callable

import numpy as np

from ...errors import NacreError
from ..colour import spectrum_to_rec709

ToRgb = Callable[[np.ndarray], np.ndarray]

_WAVELENGTH = re.compile(r"(\d{1,5}(?:\.\d{1,9})?)(?:\s*nm)?", re.IGNORECASE)


def rgb_of(names: list[str], file: str) -> tuple[ToRgb, list[str]]:
    """A function from (channel, ...) to (3, ...), and what to record of it.

    Channels are named for red, green and blue, or by their wavelengths in nanometres. Raises
    NacreError for any others.
    """
    initials = [name[:1].upper() for name in names]
    if initials == ["R", "G", "B"]:
        return (lambda planes: planes), []
    if sorted(initials) == ["B", "G", "R"]:
        order = [initials.index(initial) for initial in "RGB"]
        return (lambda planes: planes[order]), []
    wavelengths = [_WAVELENGTH.fullmatch(name) for name in names]
    if not all(wavelengths):
        shown = ", ".join(map(_shown, names[:4])) + (f", ... ({len(names)})" * (len(names) > 4))
        raise NacreError(
            f"{file} has the channels {shown}; expected red, green and blue, or wavelengths in "
            "nanometres"
        )
    nanometres = np.array([float(match[1]) for match in wavelengths if match])
    rising = np.argsort(nanometres)
    if (np.diff(nanometres[rising]) == 0).any():
        raise NacreError(f"{file} has several channels of one wavelength")
    weights = np.empty((3, len(names)), np.float32)
    weights[:, rising] = spectrum_to_rec709(nanometres[rising].tolist())

    def weighted(planes: np.ndarray) -> np.ndarray:
        return np.tensordot(weights, planes.astype(np.float32, copy=False), 1)

    return weighted, [
        f"{len(names)} wavelengths from {nanometres.min():g} to {nanometres.max():g} nm to linear "
        "Rec.709 under D65"
    ]


def _shown(name: str) -> str:
    """A name of a file's, on one line and not too long."""
    short = name[:40]
    return short if short.isprintable() else ascii(short)
