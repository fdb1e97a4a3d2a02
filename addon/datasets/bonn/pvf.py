"""PVF, the per-view factorisation: a mean and principal components for each view.

Of a view, value = mean[row] + C[row] . W[texel] with row = light * channels + channel. A transposed
file has rows texel * channels + channel and W[light]; it is recognised by its matrices' sizes, the
usual kind where these cannot tell.

The oldest files lack the header: they begin with a number of their own.
"""

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from pathlib import Path

import numpy as np

from .contents import Contents, tiles
from .cursor import Cursor
from .header import Header, Meta, read_directions, read_header, read_size
from .matrices import Matrix, place, read_scalar

# Signature: whether rotations of local frames follow the image size.
SIGNATURES = {b"!PVF06FCR": True, b"!PVF06FC": False}
_OLDEST = 301074


@dataclass(frozen=True)
class _View:
    """The factors of one view; `transposed` when C holds the texels."""

    mean: Matrix
    components: Matrix
    weights: Matrix
    transposed: bool


def read(cursor: Cursor, signature: bytes) -> Contents:
    number = cursor.u32("the header's size")
    if number == _OLDEST:
        header, slots = _read_oldest(cursor)
    else:
        cursor.back(4)
        header = read_header(cursor, SIGNATURES[signature])
        cursor.u32("the number of components")  # each view has its own
        slots = cursor.u32("the number of views' factors")
    if slots != len(header.view):
        raise cursor.damaged(f"it has the factors of {slots} views, but {len(header.view)} views")
    views = [_read_view(cursor, header, number) for number in range(slots)]
    cursor.end()
    return Contents(
        layout="PVF",
        header=header,
        half=all(view.components.scalar.itemsize == 2 for view in views),
        pieces=partial(_pieces, header, views),
        memory=max(view.components.loaded_bytes + view.weights.loaded_bytes for view in views),
        details={"components": sorted({view.components.used for view in views})},
    )


def _read_oldest(cursor: Cursor) -> tuple[Header, int]:
    cursor.u32("the number of components")
    width, height = read_size(cursor)
    slots = cursor.u32("the number of views' factors")
    view, light = read_directions(cursor)
    meta = Meta(0, 0.0, (1.0, 1.0, 1.0), None, ["R", "G", "B"])
    return Header(meta, light, view, width, height, rotated=False), slots


def _read_view(cursor: Cursor, header: Header, number: int) -> _View:
    label = f"view {number}"
    scalar = read_scalar(cursor, label)
    components, weights, rows = cursor.numbers("3I", f"{label}'s sizes")
    if components == 0:
        raise cursor.damaged(f"{label} has no components")
    lights, channels = len(header.light), header.channels
    usual = (lights * channels, header.texels)
    transposed = (rows, weights) == (header.texels * channels, lights) != usual
    if not transposed and (rows, weights) != usual:
        raise cursor.damaged(
            f"{label} has {rows} rows and {weights} weights, but its lights, channels and images "
            f"need {usual[0]} and {usual[1]}"
        )
    place(cursor, f"{label}'s eigenvalues", (1, components), scalar)
    return _View(
        mean=place(cursor, f"{label}'s mean", (rows, 1), scalar),
        components=place(cursor, f"{label}'s components", (rows, components), scalar),
        weights=place(cursor, f"{label}'s weights", (weights, components), scalar),
        transposed=transposed,
    )


def _pieces(
    header: Header, factors: list[_View], path: Path
) -> Generator[tuple[slice, np.ndarray]]:
    """Reads the factors again for each light, as all views' together may be large."""
    for _, group in groupby(_by_view(header), key=lambda tile: tile[:2]):
        loaded = None
        for light, view, texels in group:
            if loaded is None:
                loaded = _load(factors[view], path)
            planes = _decode(*loaded, factors[view].transposed, header.channels, light, texels)
            yield slice(light, light + 1), planes


def _by_view(header: Header) -> Iterator[tuple[int, int, slice]]:
    for light, views, texels in tiles(header):
        for view in range(views.start, views.stop):
            yield light, view, texels


def _load(view: _View, path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return view.mean.load(path), view.components.load(path), view.weights.load(path)


def _decode(
    mean: np.ndarray,
    components: np.ndarray,
    weights: np.ndarray,
    transposed: bool,
    channels: int,
    light: int,
    texels: slice,
) -> np.ndarray:
    """(channel, light, view, texel) of one light and one view."""
    if transposed:
        rows = slice(texels.start * channels, texels.stop * channels)
        values = components[rows] @ weights[light] + mean[rows, 0]
        planes = values.reshape(-1, channels).T
    else:
        rows = slice(light * channels, (light + 1) * channels)
        planes = components[rows] @ weights[texels].T + mean[rows]
    return planes[:, None, None]
