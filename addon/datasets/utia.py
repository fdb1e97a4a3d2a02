"""UTIA's BTF database: an image for each pair of light and view, 8-bit sRGB or half floats in XYZ.

Images are named `tl000_pl000_tv000_pv000.png` or `.exr`, after http://btf.utia.cas.cz/?data_des.
A light that would be where the camera is was moved for that one image; a list of five columns says
where to (number, theta, phi, and theta and phi when moved). A BTF has one direction for each light,
so the light is taken to be where the names have it, and that is recorded.
"""

import re
from pathlib import Path, PurePosixPath

from ..errors import NacreError
from .images import grid as image_grid
from .images.archive import Files, open_files
from .images.named_angles import named_grid
from .images.values import Encoding
from .options import Options
from .source import Source

FORMAT = "utia"
# A .zip that nobody knows goes to UBO2003.
EXTENSIONS: tuple[str, ...] = ()
OPTIONS = image_grid.OPTIONS

_ENCODING = Encoding(gamma="srgb", float_space="xyz")
_NAME = re.compile(r"tl\d{3}_pl\d{3}_tv\d{3}_pv\d{3}\.(png|exr)", re.IGNORECASE)

_LISTS = {".txt", ".dat", ".csv", ".lst"}
_MOST_LIST = 2**20
_COLUMNS = 5


def matches(path: Path) -> bool:
    """Whether this is a zip or a folder with images named as UTIA's are."""
    try:
        with open_files(path) as files:
            return any(_NAME.fullmatch(PurePosixPath(name).name) for name in files.names())
    except (OSError, NacreError):
        return False


def open_source(path: Path, options: Options) -> Source:
    """Read the names, the first image and, if there is one, the list of directions.

    Raises NacreError as the reader of UBO2003 does.
    """
    with open_files(path) as files:
        names = files.names()
        grid = named_grid(names, path.name)
        lists = [name for name in names if _moves_lights(files, name)]
    notes = [
        f"lights that were moved out of the camera's way, as {name} lists, taken where the images' "
        "names have them"
        for name in lists[:1]
    ]
    return image_grid.image_source(path, FORMAT, path, grid, _ENCODING, options, notes)


def _moves_lights(files: Files, name: str) -> bool:
    """Whether a file is a list of directions, five numbers a line, and a light of it is moved."""
    if PurePosixPath(name).suffix.lower() not in _LISTS or files.size(name) > _MOST_LIST:
        return False
    moved = False
    for line in files.read(name).decode("latin-1").splitlines():
        cells = re.split(r"[\s,;]+", line.strip())
        if cells == [""]:
            continue
        try:
            numbers = [float(cell) for cell in cells]
        except ValueError:
            return False
        if len(numbers) != _COLUMNS:
            return False
        moved |= numbers[1:3] != numbers[3:]
    return moved
