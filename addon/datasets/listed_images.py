"""Images with a CSV file that lists their directions: the way in for every other set, or your own.

The CSV has the columns file, light_theta, light_phi, view_theta and view_phi, in any order and
beside any others; angles are in degrees. The user names the CSV, and `file` is relative to its
folder, or names a folder or zip of the images and gives the CSV besides.
"""

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..errors import NacreError
from .images import grid as image_grid
from .images.archive import Files, open_files
from .images.grid import Angles, ImageGrid, Pair, angles, complete
from .images.values import Encoding
from .options import Options
from .source import Source

FORMAT = "images"
EXTENSIONS = (".csv",)
OPTIONS = image_grid.OPTIONS | {"directions"}

COLUMNS = ("file", "light_theta", "light_phi", "view_theta", "view_phi")

_ENCODING = Encoding(gamma="srgb")


def matches(path: Path) -> bool:
    """Whether this is a CSV file with the columns that are read here."""
    try:
        with _rows(path) as rows:
            return set(COLUMNS) <= set(_header(next(rows, [])))
    except (OSError, NacreError):
        return False


def open_source(path: Path, options: Options) -> Source:
    """Read the list and the first image.

    Raises NacreError, with the line's number, for a line that is damaged, names a missing file or
    one outside of the folder, or has the directions of another; for images that cannot be read;
    and for a list that is no full grid of lights and views.
    """
    if options.directions is None:
        listed, folder = path, path.parent
    else:
        listed, folder = Path(options.directions), path
    with open_files(folder) as files:
        grid = _read_list(listed, files)
    return image_grid.image_source(path, FORMAT, folder, grid, _ENCODING, options)


def _read_list(path: Path, files: Files) -> ImageGrid:
    images: dict[Pair, str] = {}
    lines: dict[Pair, int] = {}
    with _rows(path) as rows:
        header = _header(next(rows, []))
        missing = [column for column in COLUMNS if column not in header]
        if missing:
            raise NacreError(
                f"{path.name}, line 1: expected the columns {','.join(COLUMNS)}; there is no "
                f"{' and no '.join(missing)}"
            )
        for row in rows:
            if not any(cell.strip() for cell in row):
                continue
            place = f"{path.name}, line {rows.line_num}"
            if len(row) != len(header):
                raise NacreError(f"{place}: {len(row)} cells, but the header has {len(header)}")
            cells = dict(zip(header, row, strict=True))
            pair = (_angles(cells, "light", place), _angles(cells, "view", place))
            if pair in images:
                raise NacreError(f"{place}: the same directions as in line {lines[pair]}")
            images[pair] = _file(cells["file"].strip(), files, place)
            lines[pair] = rows.line_num
    if not images:
        raise NacreError(f"{path.name} lists no images")
    return complete(images, path.name)


@contextmanager
def _rows(path: Path) -> Iterator[Any]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            yield csv.reader(file)
    except OSError as error:
        raise NacreError(f"cannot read {path}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise NacreError(f"{path.name} is not a CSV text file: {error}") from error


def _header(row: list[str]) -> list[str]:
    return [cell.strip().lower() for cell in row]


def _angles(cells: dict[str, str], axis: str, place: str) -> Angles:
    numbers = []
    for column in (f"{axis}_theta", f"{axis}_phi"):
        try:
            numbers.append(float(cells[column]))
        except ValueError:
            raise NacreError(f"{place}: {column} is {cells[column]!r}; expected degrees") from None
    return angles(numbers[0], numbers[1], place)


def _file(name: str, files: Files, place: str) -> str:
    name = name.replace("\\", "/")
    if not name.isprintable():
        raise NacreError(f"{place}: {name!r} is no file")
    try:
        files.size(name)
    except NacreError as error:
        raise NacreError(f"{place}: {error}") from error
    return name
