"""Any supported file of measured appearance, or of occlusion masks, to a dataset folder."""

import os
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from ..errors import Cancelled, NacreError
from . import btf, listed_images, masks, merl, rgl, spectral, ubo2003, utia, utia_brdf
from .dataset import DESCRIPTION, Dataset, DatasetWriter, HalfOverflowError, open_dataset
from .options import Options
from .source import Source

# Where several know a file the first reads it: UBO2003 takes any named images.
# A reader is a module with FORMAT, EXTENSIONS, matches(path) -> bool, which looks at the content,
# OPTIONS, the names of those Options that it takes, and open_source(path, options) -> Source.
_READERS = (btf, utia, spectral, ubo2003, listed_images, masks, rgl, merl, utia_brdf)
READERS = {reader.FORMAT: reader for reader in _READERS}

EXTENSIONS = tuple(dict.fromkeys(ending for reader in _READERS for ending in reader.EXTENSIONS))
"""What the names of measured files end in."""

Progress = Callable[[float, str], bool]


def detect_format(source: str | Path, directions: str | Path | None = None) -> str:
    """The name of the reader for a file or folder, by its content.

    A folder of images is anything that the list `directions` makes of it. A damaged file that no
    reader knows goes to the reader of its extension, whose error says more.
    """
    path = Path(source)
    if not os.path.exists(path):
        raise NacreError(f"there is no file {path}")
    if directions is not None:
        if listed_images.matches(Path(directions)):
            return listed_images.FORMAT
        if os.path.isdir(path):
            return masks.FORMAT
    if os.path.isfile(path / DESCRIPTION):
        raise NacreError(f"{path} is a Nacre dataset already: it needs no import")
    for name, reader in READERS.items():
        if reader.matches(path):
            return name
    for name, reader in READERS.items():
        if path.suffix.lower() in reader.EXTENSIONS:
            return name
    raise NacreError(f"{path.name} is of no known format ({', '.join(READERS)})")


def describe_source(
    source: str | Path, *, format: str | None = None, **given: Any
) -> dict[str, Any]:
    """What a file holds and what importing it would do, JSON-able, without importing it.

    Arguments and errors are those of `import_dataset`.
    """
    return _open_source(source, format, Options(**given)).summary()


def import_dataset(
    source: str | Path,
    destination: str | Path,
    *,
    format: str | None = None,
    progress: Progress | None = None,
    **given: Any,
) -> Dataset:
    """Read a measured BTF or occlusion masks into the dataset folder `destination` and open it.

    `format` is a name in READERS, found out when None; `given` are fields of Options. Raises
    NacreError for anything wrong with the file or the disk, Cancelled when `progress` answers
    False; then nothing is left of the dataset, and an older one there is untouched.
    """
    opened = _open_source(source, format, Options(**given))
    try:
        _write(opened, destination, opened.dtype, progress)
    except HalfOverflowError:
        # Known only once the value is decoded, and rare: start again in single precision.
        _write(opened, destination, np.float32, progress)
    return open_dataset(destination)


def _open_source(source: str | Path, format: str | None, options: Options) -> Source:
    if format is None:
        format = detect_format(source, options.directions)
    elif format not in READERS:
        raise NacreError(f"there is no format {format}: choose from {', '.join(READERS)}")
    elif not os.path.exists(source):
        raise NacreError(f"there is no file {source}")
    reader = READERS[format]
    for option in options.given():
        if option not in reader.OPTIONS:
            flag = option.replace("_", "-")
            raise NacreError(f"{Path(source).name} is read as {format}, which takes no --{flag}")
    return reader.open_source(Path(source), options)


def _write(
    source: Source, destination: str | Path, dtype: DTypeLike, progress: Progress | None
) -> None:
    message = f"Reading {source.path.name}"
    _report(progress, 0.0, message)
    writer = DatasetWriter(destination, source.description(), source.shape, dtype)
    with writer, closing(source.blocks()) as blocks:
        write = writer.write_texels if source.by_texel else writer.write
        for block in blocks:
            write(block)
            _report(progress, writer.fraction, message)


def _report(progress: Progress | None, fraction: float, message: str) -> None:
    if progress is not None and not progress(fraction, message):
        raise Cancelled
