"""A grey picture as numbers from 0 to 1."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import NacreError
from .decoding import decode


def read_grey(path: Path) -> NDArray[np.float32]:
    """The pixels (y, x) of a grey picture, bottom row first: whole numbers over their type's
    largest, floats of .exr as they are.

    Raises NacreError when the file is missing, damaged, coloured, or not between 0 and 1.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise NacreError(f"{path}: cannot be read ({error.strerror})") from error
    image = decode(data, path.name)
    pixels = image.pixels
    if image.bands != "RGB" or (pixels != pixels[..., :1]).any():
        raise NacreError(f"{path}: is coloured; a grey picture is expected")
    grey = np.asarray(pixels[::-1, :, 0], np.float32)
    if pixels.dtype.kind == "u":
        grey /= np.float32(np.iinfo(pixels.dtype).max)
    if not (grey.min() >= 0.0 and grey.max() <= 1.0):
        raise NacreError(f"{path}: has values outside 0 to 1")
    return grey
