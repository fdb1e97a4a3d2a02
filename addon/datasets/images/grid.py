"""BTFs that are one image for each pair of light and view: a full grid of directions, streamed."""

import itertools
import math
from collections.abc import Generator, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...errors import NacreError
from ..directions import is_above_horizon, spherical_to_unit
from ..options import Options
from ..source import BLOCK_BYTES, CHANNELS, Source, assumed_patch_size
from .archive import Files, open_files
from .decoding import Bands, Image, decode
from .values import OPTIONS as VALUE_OPTIONS
from .values import Decoding, Encoding, choose_decoding

OPTIONS = VALUE_OPTIONS | {"patch_width"}
"""The names of the Options that are heeded here."""

Angles = tuple[float, float]
"""theta and phi in degrees, phi in [0, 360)."""

Pair = tuple[Angles, Angles]
"""Light and view."""

# Angles that differ by less are the same one, computed twice.
_DECIMALS = 4
_MOST_SHOWN = 3


@dataclass(frozen=True)
class ImageGrid:
    """The angles of lights and views, sorted, and the images' names in the order (light, view)."""

    lights: list[Angles]
    views: list[Angles]
    names: list[str]


class _Kind(NamedTuple):
    """What all images of a set have in common."""

    width: int
    height: int
    stored: np.dtype
    bands: Bands


def _kind(image: Image) -> _Kind:
    height, width, _ = image.pixels.shape
    return _Kind(width, height, image.pixels.dtype, image.bands)


def angles(theta: float, phi: float, place: str) -> Angles:
    """A direction in degrees as one of a grid; NacreError unless above the surface."""
    if not (math.isfinite(theta) and math.isfinite(phi)):
        raise NacreError(f"{place}: the angles must be finite numbers")
    if not is_above_horizon(theta):
        raise NacreError(f"{place}: theta {theta:g} points below the surface (at most 90 degrees)")
    # Rounding may make 360 of what was below; adding 0 makes 0 of -0.
    return round(theta, _DECIMALS) + 0.0, round(phi % 360.0, _DECIMALS) % 360.0 + 0.0


def complete(images: Mapping[Pair, str], source: str) -> ImageGrid:
    """The grid of all lights and all views; NacreError when `source` lacks an image of it."""
    lights = sorted({light for light, _ in images})
    views = sorted({view for _, view in images})
    pairs: Iterable[Pair] = itertools.product(lights, views)
    missing = len(lights) * len(views) - len(images)
    if missing:
        gaps = itertools.islice((pair for pair in pairs if pair not in images), _MOST_SHOWN)
        shown = "; ".join(
            f"tl {light[0]:g} pl {light[1]:g} tv {view[0]:g} pv {view[1]:g}" for light, view in gaps
        )
        more = f" (and {missing - _MOST_SHOWN} more)" if missing > _MOST_SHOWN else ""
        raise NacreError(
            f"{source} lacks the image for {shown}{more}: {len(lights)} lights by {len(views)} "
            f"views are needed, and {len(images)} images are there"
        )
    return ImageGrid(lights, views, [images[pair] for pair in pairs])


def image_source(
    path: Path,
    format: str,
    folder: Path,
    grid: ImageGrid,
    encoding: Encoding,
    options: Options,
    notes: Iterable[str] = (),
) -> Source:
    """The source of a grid's images in `folder`, a folder or zip; `path` is what the user named.

    Reads the first image. Raises NacreError when it cannot be read, or when one is missing.
    """
    with open_files(folder) as files:
        sizes = [files.size(name) for name in grid.names]
        first = decode(files.read(grid.names[0]), grid.names[0])
    decoding = choose_decoding(first, encoding, options)
    kind = _kind(first)
    width, height = kind.width, kind.height
    patch_size = assumed_patch_size(width, height)
    scale = f"no scale in the file: patch taken as {patch_size[0]:g} m wide"
    if options.patch_width is not None:
        patch_size = options.patch_width, options.patch_width * height / width
        scale = f"patch taken as {options.patch_width:g} m wide, as asked"
    light = spherical_to_unit(*zip(*grid.lights, strict=True))
    return Source(
        path=path,
        format=format,
        light=light,
        view=spherical_to_unit(*zip(*grid.views, strict=True)),
        shape=(len(grid.lights), len(grid.views), height, width, len(CHANNELS)),
        dtype=np.dtype("<f2" if first.fits_half else "<f4"),
        patch_size=patch_size,
        conversions=[*decoding.conversions, *notes, scale],
        details={},
        bytes=folder.stat().st_size if folder.is_file() else sum(sizes),
        blocks=partial(_blocks, folder, grid, kind, decoding, light[:, 2]),
    )


def _blocks(
    folder: Path, grid: ImageGrid, first: _Kind, decoding: Decoding, cosines: np.ndarray
) -> Generator[np.ndarray]:
    """Samples (views, y, x, channel) float32: for each light, a few views at a time."""
    views = len(grid.views)
    image = (first.height, first.width, len(CHANNELS))
    step = max(1, BLOCK_BYTES // (4 * math.prod(image)))
    with open_files(folder) as files:
        for light, cosine in enumerate(cosines):
            names = grid.names[light * views : (light + 1) * views]
            for start in range(0, views, step):
                chunk = names[start : start + step]
                block = np.empty((len(chunk), *image), np.float32)
                # One after the other: threads make small images slower, not faster.
                for values, name in zip(block, chunk, strict=True):
                    pixels = _load(files, name, grid.names[0], first)
                    values[...] = decoding.values(pixels, cosine)
                yield block


def _load(files: Files, name: str, first_name: str, first: _Kind) -> np.ndarray:
    """An image (y, x, band) like the first, its first row at the bottom."""
    image = decode(files.read(name), name)
    kind = _kind(image)
    if (kind.width, kind.height) != (first.width, first.height):
        raise NacreError(
            f"{name} has {kind.width} x {kind.height} pixels, but {first_name} has "
            f"{first.width} x {first.height}: all images must be of one size"
        )
    if kind != first:
        raise NacreError(f"{name} is another kind of image than {first_name}: all must be alike")
    return image.pixels[::-1]
