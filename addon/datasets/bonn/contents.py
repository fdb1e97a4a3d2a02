"""What every layout hands over, and the pieces that it decodes at a time."""

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..source import BLOCK_BYTES
from .header import Header


@dataclass(frozen=True)
class Contents:
    """A file's description, and its values.

    `half`: whether all values are stored as half floats. `named`: whether the decoded channels are
    those that the header names; if not they are RGB. `pieces(path)` yields which lights and their
    decoded values (channel, light, view, texel), in the order of a dataset, or where `by_texel`
    all lights and views of consecutive texels. That takes `memory` bytes besides a few blocks.
    `details` are for `info`.
    """

    layout: str
    header: Header
    half: bool
    pieces: Callable[[Path], Generator[tuple[slice, np.ndarray]]]
    named: bool = True
    by_texel: bool = False
    memory: int = 0
    conversions: list[str] = field(default_factory=list)
    details: dict[str, Any] = field(default_factory=dict)


def tiles(header: Header) -> Iterator[tuple[int, slice, slice]]:
    """(light, views, texels) in the order of a dataset, as many as a block may hold as float32.

    There are several views only where all texels of each are in.
    """
    texels = header.texels
    most = max(1, BLOCK_BYTES // (4 * max(header.channels, 3)))
    views, step = max(1, most // texels), min(texels, most)
    for light in range(len(header.light)):
        for view in range(0, len(header.view), views):
            last = min(view + views, len(header.view))
            for texel in range(0, texels, step):
                yield light, slice(view, last), slice(texel, min(texel + step, texels))
