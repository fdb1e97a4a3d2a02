"""Occlusion masks: a folder of PNG images, or a .npy array (view, y, x) with y growing upward.

A list of directions gives the view of each mask, in the order of the array or of the images' names,
where numbers count by their value. Half covered and more is covered; in an image that is white or,
where there is an alpha channel, opaque.
"""

import re
from collections.abc import Generator
from functools import partial
from pathlib import Path

import numpy as np

from ..errors import NacreError
from .directions import read_directions_csv
from .options import Options
from .source import DEFAULT_PATCH_WIDTH, Source, assumed_patch_size

FORMAT = "masks"
EXTENSIONS = (".npy",)
OPTIONS = frozenset({"directions"})

_MAGIC = b"\x93NUMPY"
_PARTS = re.compile(r"(\D*)(\d*)")


def matches(path: Path) -> bool:
    """Whether this is a .npy file; a folder of images says nothing of what they show."""
    try:
        with path.open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False


def open_source(path: Path, options: Options) -> Source:
    """Read the sizes and the CSV file of view directions, one a mask.

    Raises NacreError for a folder without PNG images, an array that is not coverage (view, y, x),
    and another number of directions than masks.
    """
    directions = options.directions
    if directions is None:
        raise NacreError(f"{path.name} holds masks: give --directions CSV, the view of each")
    view = read_directions_csv(directions)
    conversions = [f"no scale in the file: patch taken as {DEFAULT_PATCH_WIDTH} m wide"]
    if path.is_dir():
        images = _images(path)
        count, (height, width) = len(images), _read_image(images[0]).shape
        blocks = partial(_image_blocks, images, (height, width))
        size = sum(image.stat().st_size for image in images)
    else:
        array = _open_array(path)
        count, height, width = array.shape
        blocks = partial(_array_blocks, array, _full(array, path.name))
        size = path.stat().st_size
    if count != len(view):
        raise NacreError(
            f"{path.name} holds {count} masks, but {Path(directions).name} lists {len(view)} "
            "directions: give one a mask"
        )
    return Source(
        path=path,
        format=FORMAT,
        light=None,
        view=view,
        shape=(count, height, width),
        dtype=np.dtype("<f2"),
        patch_size=assumed_patch_size(width, height),
        conversions=conversions,
        details={},
        bytes=size,
        blocks=blocks,
        kind="occlusion",
    )


# --- images ---------------------------------------------------------------------------------------


def _images(folder: Path) -> list[Path]:
    """The PNG images of a folder, view_2 before view_10."""
    images = [path for path in folder.glob("[!.]*") if path.suffix.lower() == ".png"]
    if not images:
        raise NacreError(f"{folder.name} holds no PNG images")

    def order(path: Path) -> list[tuple[str, int]]:
        return [(text, int(number or -1)) for text, number in _PARTS.findall(path.stem)]

    return sorted(images, key=order)


def _image_blocks(images: list[Path], shape: tuple[int, ...]) -> Generator[np.ndarray]:
    for path in images:
        covered = _read_image(path)
        if covered.shape != shape:
            raise NacreError(
                f"{path.name} has {covered.shape[1]} x {covered.shape[0]} pixels, but "
                f"{images[0].name} has {shape[1]} x {shape[0]}: all masks must be of one size"
            )
        yield covered.astype(np.float16)


def _read_image(path: Path) -> np.ndarray:
    """What an image covers (y, x) bool, its first row at the bottom."""
    try:
        from PIL import Image
    except ImportError as error:
        raise NacreError("reading images needs the Python package Pillow: install it") from error
    try:
        with Image.open(path, formats=("PNG",)) as image:
            if image.has_transparency_data:
                pixels = np.asarray(image.convert("RGBA").getchannel("A"))
            elif image.mode.startswith("I"):  # 16 bits of grey, which "L" would clip
                pixels = np.asarray(image) >> 8
            else:
                pixels = np.asarray(image.convert("L"))
    except Exception as error:  # a damaged image may raise anything a decoder thinks of
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise NacreError(f"{path.name} cannot be read as a PNG image: {reason}") from error
    return pixels[::-1] >= 128


# --- arrays ---------------------------------------------------------------------------------------


def _open_array(path: Path) -> np.ndarray:
    """The array of a .npy file, mapped and not read."""
    try:
        with path.open("rb") as file:
            if np.lib.format.read_magic(file) != (1, 0):
                # Later ones may claim headers of gigabytes, which numpy makes room for.
                raise ValueError("its header is not of version 1.0")
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # numpy lets its tokenizer's errors through
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise NacreError(f"{path.name} cannot be read as a .npy file: {reason}") from error
    if not isinstance(array, np.ndarray) or array.ndim != 3 or array.size == 0:
        found = getattr(array, "shape", "an archive")
        raise NacreError(f"{path.name} is {found}; expected an array of masks (view, y, x)")
    if array.dtype.kind not in "biuf":
        raise NacreError(f"{path.name} holds {array.dtype}; expected numbers or booleans")
    return array


def _full(array: np.ndarray, name: str) -> float:
    """The value of full coverage: 1, or 255 in an array of whole numbers that go beyond 1."""
    least, most = float(array.min()), float(array.max())
    full = 255.0 if array.dtype.kind in "iu" and most > 1.0 else 1.0
    if not 0.0 <= least <= most <= full:  # false for NaN, too
        raise NacreError(
            f"{name} has values from {least:g} to {most:g}; expected masks, 0 to 1 or 0 to 255"
        )
    return full


def _array_blocks(array: np.ndarray, full: float) -> Generator[np.ndarray]:
    for mask in array:
        yield (mask >= 0.5 * full).astype(np.float16, order="C")
