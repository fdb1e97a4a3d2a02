"""DFMF, the decorrelated full matrix factorisation: what Bonn's database of 2014 is in.

For each stored channel the file holds U and SxV with value = U[row] . SxV[column], where
row = view * lights + light and the column is the texel. A transposed file holds the texels in U and
the directions in SxV; it is recognised by its matrices' sizes. When there are as many texels as
pairs of directions, sizes cannot tell, and the file is taken to be the usual, not transposed, kind
(btflib does the same).
"""

from collections.abc import Generator
from functools import partial
from pathlib import Path

import numpy as np

from .colour_models import ColourModel
from .contents import Contents, tiles
from .cursor import Cursor
from .header import Header, read_header
from .matrices import Matrix, place, read_scalar

# Signature: whether rotations of local frames follow the image size.
SIGNATURES = {b"!DFMF08FCR": True, b"!DFMF08FC": False}


def read(cursor: Cursor, signature: bytes) -> Contents:
    header = read_header(cursor, SIGNATURES[signature])
    cursor.u32("the number of components")  # each channel has its own
    model = _read_colour_model(cursor)
    model.check(cursor.name, header.channels)
    factors = [_read_channel(cursor, header, c + 1) for c in range(header.channels)]
    cursor.end()
    conversions = []
    if model.number != 0:
        conversions.append(f"colour model {model.label} decoded to linear channels")
    directions, texels = zip(*factors, strict=True)
    return Contents(
        layout="DFMF",
        header=header,
        half=all(matrix.scalar.itemsize == 2 for matrix in directions),
        named=model.named,
        pieces=partial(_pieces, header, model, directions, texels),
        memory=sum(matrix.loaded_bytes for pair in factors for matrix in pair),
        conversions=conversions,
        details={
            "colour_model": model.label,
            "components": [matrix.used for matrix in directions],
        },
    )


def _read_colour_model(cursor: Cursor) -> ColourModel:
    number, *values = cursor.numbers("i12f", "the colour model")
    return ColourModel(number, np.array(values[:3]), np.array(values[3:]).reshape(3, 3))


def _read_channel(cursor: Cursor, header: Header, number: int) -> tuple[Matrix, Matrix]:
    """The factors of one channel, (directions, texels); the file holds S, U and SxV."""
    label = f"channel {number}"
    scalar = read_scalar(cursor, label)
    components, rows, columns = cursor.numbers("3I", f"{label}'s sizes")
    if components == 0:
        raise cursor.damaged(f"{label} has no components")
    usual = (header.pairs, header.texels)
    transposed = (columns, rows) == usual != (rows, columns)
    if not transposed and (rows, columns) != usual:
        raise cursor.damaged(
            f"{label} is a matrix of {rows} x {columns}, but its directions and images need "
            f"{usual[0]} x {usual[1]}"
        )
    place(cursor, f"{label}'s singular values", (1, components), scalar)
    u = place(cursor, f"{label}'s U", (rows, components), scalar)
    v = place(cursor, f"{label}'s SxV", (columns, components), scalar)
    return (v, u) if transposed else (u, v)


def _pieces(
    header: Header,
    model: ColourModel,
    directions: tuple[Matrix, ...],
    texels: tuple[Matrix, ...],
    path: Path,
) -> Generator[tuple[slice, np.ndarray]]:
    by_view = [
        matrix.load(path).reshape(len(header.view), len(header.light), -1) for matrix in directions
    ]
    by_texel = [matrix.load(path) for matrix in texels]
    for light, views, some in tiles(header):
        planes = [u[views, light] @ v[some].T for u, v in zip(by_view, by_texel, strict=True)]
        yield slice(light, light + 1), model.decode(np.stack(planes))[:, None]
