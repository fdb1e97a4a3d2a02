"""Anything that can be compared, read in blocks: datasets, models, pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import prod
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .datasets.dataset import DESCRIPTION, KINDS, open_dataset
from .errors import NacreError

BLOCK_BYTES = 32 * 2**20
"""What is worked on at a time, as float32."""


@dataclass(frozen=True)
class Samples:
    """Samples of some shape; `read` gives a slice along the first axis; bytes are the files'.

    value is "mask" or "signed-distance" of occlusion, "" of anything else.
    """

    shape: tuple[int, ...]
    read: Callable[[slice], NDArray[np.floating]]
    bytes: int
    value: str = ""


def open_samples(path: Path) -> Samples:
    """A dataset, a model or a .png or .exr picture; NacreError for anything else.

    Pictures are (height, width, 3), bottom row first.
    """
    if (path / DESCRIPTION).is_file():
        dataset = open_dataset(path)
        size = sum(item.stat().st_size for item in path.iterdir())
        return Samples(dataset.shape, dataset.samples.__getitem__, size, dataset.value)
    if not path.is_file():
        raise NacreError(f"{path}: no such file or dataset")
    kind = path.suffix.lower()
    size = path.stat().st_size
    if kind == ".png":
        pixels = _read_png(path)
        return Samples(pixels.shape, pixels.__getitem__, size)
    if kind != ".exr":
        raise NacreError(f"{path}: expected a dataset, a model, or a .png or .exr picture")
    from .models.any_model import load_any
    from .models.exr import is_model, read_picture

    if is_model(path):
        model = load_any(path)
        first = KINDS[model.kind][0]
        return Samples(
            model.shape,
            lambda part: model.decode(**{first: part}),
            size,
            model.dataset.get("value", ""),
        )
    picture = read_picture(path)
    return Samples(picture.shape, picture.__getitem__, size)


def blocks(shape: tuple[int, ...]) -> Iterator[slice]:
    """Slices along the first axis of samples, of about BLOCK_BYTES each."""
    count = max(1, BLOCK_BYTES // (4 * prod(shape[1:])))
    for first in range(0, shape[0], count):
        yield slice(first, min(first + count, shape[0]))


def _read_png(path: Path) -> NDArray[np.float64]:
    from PIL import Image

    try:
        with Image.open(path) as image:
            return np.asarray(image.convert("RGB"), np.float64)[::-1] / 255.0
    except (OSError, SyntaxError) as error:
        raise NacreError(f"{path}: cannot be read as a PNG ({error})") from error
