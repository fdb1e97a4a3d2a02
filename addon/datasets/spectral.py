"""Bonn's spectral BTFs: an OpenEXR image for each pair of light and view, a channel a wavelength.

The images are named by their angles, `tv%f_pv%f_tl%f_pl%f.exr`. Values are linear.
"""

from pathlib import Path

from ..errors import NacreError
from .images import exr as exr_image
from .images import grid as image_grid
from .images.archive import open_files
from .images.decoding import suffix
from .images.named_angles import named_grid
from .images.values import Encoding
from .options import Options
from .source import Source

FORMAT = "spectral"
# A .zip that nobody knows goes to UBO2003.
EXTENSIONS: tuple[str, ...] = ()
OPTIONS = image_grid.OPTIONS - {"colour_space"}

_ENCODING = Encoding(gamma=1.0)


def matches(path: Path) -> bool:
    """Whether this is a zip or a folder of OpenEXR images, the first of them a spectrum's."""
    try:
        with open_files(path) as files:
            images = [name for name in files.names() if suffix(name) == ".exr"]
            return bool(images) and _is_spectrum(files.read(images[0]), images[0])
    except (OSError, NacreError):
        return False


def open_source(path: Path, options: Options) -> Source:
    """Read the names and the first image.

    Raises NacreError as the reader of UBO2003 does, and for images that are no spectra.
    """
    with open_files(path) as files:
        grid = named_grid(files.names(), path.name)
        first = grid.names[0]
        if suffix(first) != ".exr" or not _is_spectrum(files.read(first), first):
            raise NacreError(
                f"{path.name}: {first} is no OpenEXR image with a channel a wavelength"
            )
    return image_grid.image_source(path, FORMAT, path, grid, _ENCODING, options)


def _is_spectrum(data: bytes, name: str) -> bool:
    return not isinstance(exr_image.bands(data, name), str)
