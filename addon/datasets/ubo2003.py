"""UBO2003 and ATRIUM (University of Bonn): an image for each pair of light and view, in a zip.

The images are named by their angles. JPEG and PNG images have a gamma of 2.2, ATRIUM's HDR ones are
linear Radiance pictures; all include cos(theta_light). Any set of images named so is read, also
from a folder, unless it is one of UTIA's or Bonn's spectral ones.
"""

from pathlib import Path

from ..errors import NacreError
from .images import grid as image_grid
from .images.archive import open_files
from .images.decoding import SUFFIXES, suffix
from .images.named_angles import named_grid
from .images.values import Encoding
from .options import Options
from .source import Source

FORMAT = "ubo2003"
EXTENSIONS = (".zip",)
OPTIONS = image_grid.OPTIONS

_ENCODING = Encoding(gamma=2.2)


def matches(path: Path) -> bool:
    """Whether this is a zip or a folder with an image in it."""
    try:
        with open_files(path) as files:
            return any(suffix(name) in SUFFIXES for name in files.names())
    except (OSError, NacreError):
        return False


def open_source(path: Path, options: Options) -> Source:
    """Read the names and the first image.

    Raises NacreError for a file that is no zip or has no images, for an image without angles or
    that cannot be read, and for a grid with gaps or doubles.
    """
    with open_files(path) as files:
        grid = named_grid(files.names(), path.name)
    return image_grid.image_source(path, FORMAT, path, grid, _ENCODING, options)
