"""FMF, the full matrix factorisation: one for all channels.

value = U[row] . SxV[texel] with row = (view * lights + light) * channels + channel. A transposed
file has U[texel * channels + channel] and SxV[view * lights + light]. Newer files say whether the
values are logarithms, and may hold the height map that their images were resampled to.
"""

from collections.abc import Generator
from functools import partial
from pathlib import Path

import numpy as np

from ...errors import NacreError
from .colour_models import LOG_OFFSET
from .contents import Contents, tiles
from .cursor import Cursor
from .header import Header, read_header
from .matrices import Matrix, place, read_scalar

# Signature: whether rotations of local frames follow the image size.
SIGNATURES = {b"!FMF12FCER": True, b"!FMF06FCR": True, b"!FMF06FC": False}
_WITH_EXTENSION = b"!FMF12FCER"


def read(cursor: Cursor, signature: bytes) -> Contents:
    header = read_header(cursor, SIGNATURES[signature])
    logarithms, height_map = False, (0, 0)
    if signature == _WITH_EXTENSION:
        logarithms, height_map = _read_extension(cursor)
    u, v, transposed = _read_factors(cursor, header)
    cursor.end()
    conversions = []
    if logarithms:
        conversions.append("logarithms decoded to linear values")
    if height_map != (0, 0):
        conversions.append(f"height map of {height_map[0]} x {height_map[1]} texels left out")
    return Contents(
        layout="FMF",
        header=header,
        half=u.scalar.itemsize == 2,
        pieces=partial(_pieces, header, u, v, transposed, logarithms),
        memory=u.loaded_bytes + v.loaded_bytes,
        conversions=conversions,
        details={"components": [u.used]},
    )


def _read_extension(cursor: Cursor) -> tuple[bool, tuple[int, int]]:
    """Whether values are logarithms, and the size of the height map, (0, 0) without."""
    version = cursor.numbers("B", "the version of the FMF header")[0]
    if version > 2:
        raise NacreError(
            f"{cursor.name} has the FMF header version {version}; 0 to 2 are supported"
        )
    logarithms = version >= 1 and cursor.u32("the dynamic range reduction") != 0
    width, height = cursor.numbers("2I", "the height map's size") if version >= 2 else (0, 0)
    cursor.skip(2 * width * height, f"a height map of {width} x {height} texels")
    return logarithms, (width, height) if width * height else (0, 0)


def _read_factors(cursor: Cursor, header: Header) -> tuple[Matrix, Matrix, bool]:
    """U, SxV, and whether U holds the texels."""
    most = cursor.u32("the number of components")
    scalar = read_scalar(cursor, "the matrix")
    components, rows, columns = cursor.numbers("3I", "the matrix's sizes")
    if components == 0:
        raise cursor.damaged("it has no components")
    usual = (header.pairs * header.channels, header.texels)
    transposed = (rows, columns) == (header.texels * header.channels, header.pairs) != usual
    if not transposed and (rows, columns) != usual:
        raise cursor.damaged(
            f"its matrix is one of {rows} x {columns}, but its directions, channels and images "
            f"need {usual[0]} x {usual[1]}"
        )
    # The first count is how many of the stored components are to be used.
    used = max(1, min(most, components))
    place(cursor, "the singular values", (1, components), scalar)
    u = place(cursor, "U", (rows, components), scalar, used)
    return u, place(cursor, "SxV", (columns, components), scalar, used), transposed


def _pieces(
    header: Header, u: Matrix, v: Matrix, transposed: bool, logarithms: bool, path: Path
) -> Generator[tuple[slice, np.ndarray]]:
    lights, views, channels = len(header.light), len(header.view), header.channels
    # One of the two has channels, the other a single one for all.
    left, right = u.load(path), v.load(path)
    if transposed:
        by_texel = left.reshape(header.texels, channels, -1)
        by_view = right.reshape(views, lights, 1, -1)
    else:
        by_texel = right.reshape(header.texels, 1, -1)
        by_view = left.reshape(views, lights, channels, -1)
    for light, some_views, texels in tiles(header):
        directions = by_view[some_views, light].transpose(1, 0, 2)
        planes = directions @ by_texel[texels].transpose(1, 2, 0)
        if logarithms:
            planes = np.exp(planes, out=planes) - LOG_OFFSET
        yield slice(light, light + 1), planes[:, None]
