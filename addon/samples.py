"""Anything that can be compared, as a shape and a stream of blocks: datasets, models, pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .datasets.dataset import DESCRIPTION, open_dataset
from .errors import NacreError


@dataclass(frozen=True)
class Samples:
    """Samples in C order: `blocks()` yields them along the first axis; bytes are the files'."""

    shape: tuple[int, ...]
    blocks: Callable[[], Iterator[NDArray[np.floating]]]
    bytes: int


def open_samples(path: Path) -> Samples:
    """A dataset, a model (decoded block by block) or a .png or .exr picture (height, width, 3).

    Raises NacreError for anything else.
    """
    if (path / DESCRIPTION).is_file():
        dataset = open_dataset(path)
        size = sum(item.stat().st_size for item in path.iterdir())
        return Samples(dataset.shape, lambda: iter(dataset.samples), size)
    if not path.is_file():
        raise NacreError(f"{path}: no such file or dataset")
    kind = path.suffix.lower()
    if kind == ".png":
        return _picture(_read_png(path), path)
    if kind != ".exr":
        raise NacreError(f"{path}: expected a dataset, a model, or a .png or .exr picture")
    from .models.exr import is_model, load_model, read_picture

    if not is_model(path):
        return _picture(read_picture(path), path)
    model = load_model(path)
    lights = range(model.shape[0])
    return Samples(model.shape, lambda: (model.decode([i])[0] for i in lights), path.stat().st_size)


def _picture(pixels: NDArray[np.floating], path: Path) -> Samples:
    return Samples(pixels.shape, lambda: iter([pixels]), path.stat().st_size)


def _read_png(path: Path) -> NDArray[np.float64]:
    from PIL import Image

    try:
        with Image.open(path) as image:
            return np.asarray(image.convert("RGB"), np.float64) / 255.0
    except (OSError, SyntaxError) as error:
        raise NacreError(f"{path}: cannot be read as a PNG ({error})") from error
