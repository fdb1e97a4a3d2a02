"""OpenEXR pictures: colours, or spectra with one channel for each wavelength."""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import NacreError
from ...openexr import quiet
from .size import check_claim

MAGIC = b"\x76\x2f\x31\x01"

# 550, 550nm, w550nm, T.550,0nm or wavelength_550.5: in nm, within what any camera sees.
_WAVELENGTH = re.compile(r"(?:[A-Za-z]\w*?[._ ])??[A-Za-z_ ]*(\d+(?:[.,]\d+)?) *(?:nm)?", re.ASCII)
_SHORTEST, _LONGEST = 200.0, 3000.0
# With fewer there is no spectrum to speak of.
_FEWEST_BANDS = 3


@dataclass(frozen=True)
class _Header:
    """Of the first part; windows are [[left, top], [right, bottom]]."""

    parts: int
    names: list[str]
    data: list[list[int]]
    display: list[list[int]]
    subsampled: bool


def bands(data: bytes, name: str) -> str | tuple[float, ...]:
    """What the channels are ("RGB", "XYZ" or ascending wavelengths in nm), from the header alone.

    Raises NacreError like `read`.
    """
    return _channels(_header(data, name), name)[0]


def read(data: bytes, name: str) -> tuple[np.ndarray, str | tuple[float, ...]]:
    """Pixels (row, column, channel) float16 or float32, top row first, and what the channels are.

    Raises NacreError for a damaged or cut file, for other parts and channels than one of colours or
    a spectrum, and when the package OpenEXR is missing.
    """
    found, channels = _channels(_header(data, name), name)
    with _library(name) as library:
        parts = library.File(io.BytesIO(data), separate_channels=True, num_threads=0).parts
        if not parts:  # so it says that some of the pixels are missing
            raise NacreError(f"{name} is damaged or cut short")
        planes = [parts[0].channels[channel].pixels for channel in channels]
    if any(plane.dtype.kind != "f" for plane in planes):
        raise NacreError(f"{name} has whole numbers as pixels; half or single floats are expected")
    return np.stack(planes, axis=-1), found


def _header(data: bytes, name: str) -> _Header:
    """The header, once what it claims has been found believable."""
    with _library(name) as library:
        parts = library.File(io.BytesIO(data), header_only=True, num_threads=0).parts
        header = parts[0].header
        channels = header["channels"]
        found = _Header(
            parts=len(parts),
            names=[channel.name for channel in channels],
            data=[corner.tolist() for corner in header["dataWindow"]],
            display=[corner.tolist() for corner in header["displayWindow"]],
            subsampled=any(c.xSampling != 1 or c.ySampling != 1 for c in channels),
        )
    if found.parts != 1:
        raise NacreError(f"{name} has {found.parts} parts; a picture of one is expected")
    (left, top), (right, bottom) = found.data
    check_claim(name, right - left + 1, bottom - top + 1, len(found.names), len(data))
    if found.subsampled:
        raise NacreError(f"{name} has subsampled channels")
    if found.display != found.data:
        raise NacreError(
            f"{name} is a crop of a larger picture: its data and display windows differ"
        )
    return found


@contextmanager
def _library(name: str) -> Iterator[Any]:
    """The OpenEXR library, silent; whatever it raises, also later than at once, as NacreError."""
    try:
        import OpenEXR
    except ImportError as error:
        raise NacreError("reading .exr needs the Python package OpenEXR: install it") from error
    try:
        with quiet():
            yield OpenEXR
    except NacreError:
        raise
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise NacreError(f"{name} cannot be read as an OpenEXR picture: {reason}") from error


def _channels(header: _Header, name: str) -> tuple[str | tuple[float, ...], list[str]]:
    """What the channels are, and their names in that order."""
    names = header.names
    spectrum = []
    for channel in names:
        found = _WAVELENGTH.fullmatch(channel)
        if found and _SHORTEST <= (nm := float(found[1].replace(",", "."))) <= _LONGEST:
            spectrum.append((nm, channel))
    if len(spectrum) >= _FEWEST_BANDS:
        spectrum.sort()
        wavelengths = tuple(nm for nm, _ in spectrum)
        if len(set(wavelengths)) < len(wavelengths):
            raise NacreError(f"{name} has several channels of one wavelength")
        return wavelengths, [channel for _, channel in spectrum]
    for colours in ("RGB", "XYZ"):
        if set(colours) <= set(names):
            return colours, list(colours)
    if names == ["Y"]:
        return "RGB", ["Y", "Y", "Y"]
    shown = [text if text.isprintable() else ascii(text) for text in names[:5]]
    listed = ", ".join(shown) + ("..." if len(names) > 5 else "")
    raise NacreError(
        f"{name} has the channels {listed}; expected R, G, B or X, Y, Z or wavelengths"
    )
