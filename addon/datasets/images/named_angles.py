"""Images named by their angles, as in Bonn's and UTIA's databases.

A name holds `tl`, `pl`, `tv` and `pv` with numbers: theta and phi of light and view in degrees, in
any order and with any separators, whole or not. The grid of directions is built from the names
alone, whatever it is.
"""

import re
from collections.abc import Iterable
from pathlib import PurePosixPath

from ...errors import NacreError
from .decoding import OTHER_SUFFIXES, SUFFIXES, suffix
from .grid import ImageGrid, Pair, angles, complete

_KEYS = ("tl", "pl", "tv", "pv")
_ANGLE = re.compile(r"(tl|pl|tv|pv)[ _]*([+-]?\d+(?:\.\d+)?)", re.IGNORECASE)


def named_grid(names: Iterable[str], source: str) -> ImageGrid:
    """The images' grid; files that are no images are passed over.

    Raises NacreError for no images, for one without angles, of a kind that cannot be read or below
    the surface, and for a grid with gaps or doubles.
    """
    images: dict[Pair, str] = {}
    for name in names:
        if suffix(name) in OTHER_SUFFIXES:
            raise NacreError(f"{source}: {name} is of a kind of image that cannot be read")
        if suffix(name) not in SUFFIXES:
            continue
        pair = _pair(name, f"{source}: {name}")
        if pair in images:
            raise NacreError(f"{source}: {images[pair]} and {name} have the same angles")
        images[pair] = name
    if not images:
        raise NacreError(f"{source} holds no images ({', '.join(sorted(SUFFIXES))})")
    return complete(images, source)


def _pair(name: str, place: str) -> Pair:
    """A key that comes more than once counts where it is last: the angles end the name."""
    found = {key.lower(): float(value) for key, value in _ANGLE.findall(PurePosixPath(name).stem)}
    if len(found) != len(_KEYS):
        raise NacreError(
            f"{place} has no angles in its name; expected tl, pl, tv and pv with numbers"
        )
    return angles(found["tl"], found["pl"], place), angles(found["tv"], found["pv"], place)
