"""UBO2003 zips (and ATRIUM's 8-bit ones): one JPEG or PNG for each pair of light and view.

The angles are in the images' names, in degrees, as `tl`, `pl`, `tv` and `pv` (theta and phi of
light and view), in any order. The grid of directions is built from the names alone, whatever it
is. A folder of such images is read like a zip. Nothing is ever unpacked to disk.

The pixels are gamma-encoded (2.2) and include cos(theta_light). Images are decoded by Pillow:
neither OpenImageIO's Python module reads from memory, nor does every Blender come with it.
"""

import io
import itertools
import math
import os
import re
import zipfile
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path, PurePosixPath

import numpy as np

from ..errors import NacreError
from .directions import is_above_horizon, spherical_to_unit
from .options import Options
from .source import BLOCK_BYTES, DEFAULT_PATCH_WIDTH, Source, assumed_patch_size

FORMAT = "ubo2003"
EXTENSIONS = (".zip",)
OPTIONS = frozenset({"cosine"})

_IMAGES = {".jpg", ".jpeg", ".png"}
_OTHER_IMAGES = {".hdr", ".exr", ".tif", ".tiff", ".bmp", ".tga", ".pfm", ".ppm", ".webp", ".gif"}
_MODES = {"RGB", "RGBA", "L", "P"}
_GAMMA = 2.2
# Far beyond any measured image: what claims to be larger is damaged, or meant to fill the memory.
_MAX_SIDE = 8192
_MAX_FILE_BYTES = 2**28

_KEYS = ("tl", "pl", "tv", "pv")
_ANGLE = re.compile(r"(tl|pl|tv|pv)[ _]*([+-]?\d+(?:\.\d+)?)", re.IGNORECASE)
_Angles = tuple[float, float]
_Read = Callable[[str], bytes]


def matches(path: Path) -> bool:
    """Whether this is a zip or a folder with a JPEG or PNG image in it."""
    try:
        if not (path.is_dir() or zipfile.is_zipfile(path)):
            return False
        with _files(path) as (names, _):
            return any(_is_image(name) for name in names)
    except (OSError, NacreError):
        return False


def open_source(path: Path, options: Options) -> Source:
    """Read the names and the first image's size.

    Raises NacreError for a file that is no zip or has no images, for an image without angles or of
    another kind than JPEG and PNG, and for a grid with gaps or doubles.
    """
    with _files(path) as (names, read):
        grid = _grid(names, path.name)
        lights = sorted({light for light, _ in grid})
        views = sorted({view for _, view in grid})
        order = _complete(grid, lights, views, path.name)
        height, width, _ = _decode(read(order[0]), order[0]).shape
    conversions = [f"8-bit values decoded with gamma {_GAMMA}"]
    if options.cosine == 0:
        conversions.append("multiplied by cos(theta_light), as asked")
    else:
        conversions.append("values taken to include cos(theta_light)")
    conversions.append(f"no scale in the file: patch taken as {DEFAULT_PATCH_WIDTH} m wide")
    light = spherical_to_unit(*zip(*lights, strict=True))
    view = spherical_to_unit(*zip(*views, strict=True))
    # What every image is multiplied by, for each light.
    factors = light[:, 2] if options.cosine == 0 else np.ones(len(light))
    return Source(
        path=path,
        format=FORMAT,
        light=light,
        view=view,
        shape=(len(lights), len(views), height, width, 3),
        dtype=np.dtype("<f2"),  # finer than 8 bits everywhere
        patch_size=assumed_patch_size(width, height),
        conversions=conversions,
        details={},
        bytes=_size(path),
        blocks=partial(_blocks, path, order, (height, width, 3), factors),
    )


def _blocks(
    path: Path, order: list[str], shape: tuple[int, int, int], factors: np.ndarray
) -> Generator[np.ndarray]:
    """Samples (views, y, x, channel) float16: for each light, a few views at a time."""
    linear = (np.arange(256) / 255.0) ** _GAMMA
    views = len(order) // len(factors)
    step = max(1, BLOCK_BYTES // (2 * math.prod(shape)))
    with _files(path) as (_, read):
        for light, factor in enumerate(factors):
            table = (linear * factor).astype(np.float16)
            names = order[light * views : (light + 1) * views]
            for first in range(0, views, step):
                # One after the other: threads make small images slower, not faster.
                chunk = names[first : first + step]
                images = [_load(read, name, order[0], shape) for name in chunk]
                yield table[np.stack(images)]


def _load(read: _Read, name: str, first: str, shape: tuple[int, int, int]) -> np.ndarray:
    """An image (y, x, channel) uint8, its first row at the bottom."""
    image = _decode(read(name), name)
    if image.shape != shape:
        raise NacreError(
            f"{name} has {image.shape[1]} x {image.shape[0]} pixels, but {first} has "
            f"{shape[1]} x {shape[0]}: all images must be of one size"
        )
    return image[::-1]


def _decode(data: bytes, name: str) -> np.ndarray:
    """The pixels (row, column, channel) uint8 RGB of a JPEG or PNG file, top row first."""
    try:
        from PIL import Image
    except ImportError as error:
        raise NacreError("reading images needs the Python package Pillow: install it") from error
    try:
        with Image.open(io.BytesIO(data), formats=("JPEG", "PNG")) as image:
            if max(image.size) > _MAX_SIDE:
                raise NacreError(
                    f"{name} claims {image.width} x {image.height} pixels; at most {_MAX_SIDE} a "
                    "side are read"
                )
            if image.mode not in _MODES:
                raise NacreError(f"{name} has {image.mode} pixels; 8-bit RGB or grey is expected")
            return np.asarray(image.convert("RGB"))
    except NacreError:
        raise
    except Exception as error:  # a damaged image may raise anything a decoder thinks of
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise NacreError(f"{name} cannot be read as an image: {reason}") from error


# --- names and angles -----------------------------------------------------------------------------


def _is_image(name: str) -> bool:
    return PurePosixPath(name).suffix.lower() in _IMAGES


def _angles(name: str) -> tuple[_Angles, _Angles] | None:
    """((theta, phi) of the light, (theta, phi) of the view) in degrees, or None.

    A key that comes more than once counts where it is last: the angles end the name.
    """
    found = {key.lower(): float(value) for key, value in _ANGLE.findall(PurePosixPath(name).stem)}
    if len(found) != len(_KEYS) or not all(map(math.isfinite, found.values())):
        return None
    return (found["tl"], found["pl"] % 360.0), (found["tv"], found["pv"] % 360.0)


def _grid(names: list[str], source: str) -> dict[tuple[_Angles, _Angles], str]:
    """The images by their angles; files that are no images are passed over."""
    grid: dict[tuple[_Angles, _Angles], str] = {}
    for name in names:
        if PurePosixPath(name).suffix.lower() in _OTHER_IMAGES:
            raise NacreError(f"{source}: {name} is not supported yet; JPEG and PNG images are")
        if not _is_image(name):
            continue
        angles = _angles(name)
        if angles is None:
            raise NacreError(
                f"{source}: {name} has no angles in its name; expected tl, pl, tv and pv with "
                "numbers"
            )
        for theta, _ in angles:
            if not is_above_horizon(theta):
                raise NacreError(f"{source}: {name} has theta {theta:g}, below the surface")
        if angles in grid:
            raise NacreError(f"{source}: {grid[angles]} and {name} have the same angles")
        grid[angles] = name
    if not grid:
        raise NacreError(f"{source} holds no JPEG or PNG images")
    return grid


def _complete(
    grid: dict[tuple[_Angles, _Angles], str],
    lights: list[_Angles],
    views: list[_Angles],
    source: str,
) -> list[str]:
    """The images' names in the order (light, view); NacreError for a gap in the grid."""
    order = []
    for light, view in itertools.product(lights, views):
        name = grid.get((light, view))
        if name is None:
            missing = len(lights) * len(views) - len(grid)
            more = f" (and {missing - 1} more)" if missing > 1 else ""
            raise NacreError(
                f"{source} lacks the image for tl {light[0]:g} pl {light[1]:g} tv {view[0]:g} "
                f"pv {view[1]:g}{more}: {len(lights)} lights by {len(views)} views are needed"
            )
        order.append(name)
    return order


# --- zip or folder --------------------------------------------------------------------------------


@contextmanager
def _files(path: Path) -> Iterator[tuple[list[str], _Read]]:
    """The files' names inside a zip or a folder, and a function that reads one of them."""
    if path.is_dir():
        yield _folder_names(path), partial(_read_file, path)
        return
    try:
        archive = zipfile.ZipFile(path)
    except OSError as error:
        raise NacreError(f"cannot read {path}: {error.strerror}") from error
    except Exception as error:  # a damaged zip may raise more than BadZipFile
        raise NacreError(f"{path.name} is not a zip file or is cut short: {error}") from error
    with archive:
        names = [entry.filename for entry in archive.infolist() if not entry.is_dir()]
        yield [name for name in names if _is_wanted(name)], partial(_read_entry, archive)


def _is_wanted(name: str) -> bool:
    """Not one of the copies that some systems keep beside the files."""
    parts = PurePosixPath(name).parts
    return bool(parts) and "__MACOSX" not in parts and not parts[-1].startswith(".")


def _folder_names(path: Path) -> list[str]:
    names = []
    for folder, folders, files in os.walk(path):
        folders.sort()
        inside = Path(folder).relative_to(path)
        names += [(inside / file).as_posix() for file in sorted(files)]
    return [name for name in names if _is_wanted(name)]


def _read_file(folder: Path, name: str) -> bytes:
    try:
        return (folder / name).read_bytes()
    except OSError as error:
        raise NacreError(f"cannot read {name}: {error.strerror}") from error


def _read_entry(archive: zipfile.ZipFile, name: str) -> bytes:
    if archive.getinfo(name).file_size > _MAX_FILE_BYTES:
        raise NacreError(f"{name} is too large for an image in a zip")
    try:
        return archive.read(name)
    except Exception as error:  # each decompressor has errors of its own
        raise NacreError(f"{name} cannot be read from the zip: {error}") from error


def _size(path: Path) -> int:
    if path.is_dir():
        return sum((path / name).stat().st_size for name in _folder_names(path))
    return path.stat().st_size
