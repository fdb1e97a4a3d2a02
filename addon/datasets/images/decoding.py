"""Image files of any supported kind to arrays of numbers as they are stored.

Kinds are told by content: JPEG, PNG and BMP (decoded by Pillow), Radiance .hdr, and OpenEXR.
OpenImageIO would know them all, but not every Blender comes with it and neither does it read from
memory.
"""

import io
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from ...errors import NacreError
from . import exr, radiance_hdr
from .size import check_claim

SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".hdr", ".exr"})
"""Endings of the names of images that can be read."""

OTHER_SUFFIXES = frozenset({".tif", ".tiff", ".tga", ".pfm", ".ppm", ".webp", ".gif"})
"""Endings of the names of images that cannot."""

_MODES = {"RGB", "RGBA", "L", "P", "I;16"}

Bands = str | tuple[float, ...]
"""What the channels are: "RGB", "XYZ", or the wavelengths in nm of a spectrum, ascending."""


@dataclass(frozen=True, eq=False)
class Image:
    """Pixels (row, column, channel), top row first, as they are stored: whole numbers from 0 to
    their type's largest, or finite float16 or float32. `fits_half`: whether half floats are as fine
    as what is stored. `notes` say what was done to get there."""

    pixels: np.ndarray
    bands: Bands
    fits_half: bool = True
    notes: tuple[str, ...] = ()


def suffix(name: str) -> str:
    """The ending of a file's name, in small letters."""
    return PurePosixPath(name).suffix.lower()


def decode(data: bytes, name: str) -> Image:
    """The image in a file's bytes; NacreError, naming it, when it is damaged or not supported."""
    if data.startswith(exr.MAGIC):
        pixels, bands = exr.read(data, name)
        image = Image(pixels, bands, fits_half=pixels.dtype == np.float16)
    elif data.startswith(radiance_hdr.MAGIC):
        pixels, bands, notes = radiance_hdr.read(data, name)
        image = Image(pixels, bands, notes=notes)
    else:
        image = _decode_with_pillow(data, name)
    if image.pixels.dtype.kind == "f" and not np.isfinite(image.pixels).all():
        raise NacreError(f"{name} has values that are not finite numbers")
    return image


def _decode_with_pillow(data: bytes, name: str) -> Image:
    try:
        import PIL.Image
    except ImportError as error:
        raise NacreError("reading images needs the Python package Pillow: install it") from error
    try:
        with PIL.Image.open(io.BytesIO(data), formats=("JPEG", "PNG", "BMP")) as image:
            check_claim(name, *image.size, 3, len(data))
            if image.mode not in _MODES:
                raise NacreError(f"{name} has {image.mode} pixels; RGB or grey is expected")
            if image.mode == "I;16":
                grey = np.asarray(image)[..., None]
                return Image(np.repeat(grey, 3, axis=2), "RGB", fits_half=False)
            # Pillow reads no more of 16-bit colours.
            notes = ("of 16-bit colours the upper 8 bits read",) if _has_16_bits(image) else ()
            return Image(np.asarray(image.convert("RGB")), "RGB", notes=notes)
    except NacreError:
        raise
    except Exception as error:  # a damaged image may raise anything a decoder thinks of
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise NacreError(f"{name} cannot be read as an image: {reason}") from error


def _has_16_bits(image: Any) -> bool:
    return any("16" in str(tile[3]) for tile in getattr(image, "tile", ()))
