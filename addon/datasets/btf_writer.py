"""Datasets as `.btf` files of Bonn's (DFMF), which other programs for measured materials read.

A truncated singular value decomposition of each colour channel, in the layout that
`bonn/dfmf.py` describes, header version 4, the light's cosine included.
"""

import os
import secrets
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..errors import Cancelled, NacreError
from .bonn.colour_models import LOG_OFFSET, YUV_TO_RGB, ColourModel
from .dataset import Dataset
from .directions import is_above_horizon, unit_to_spherical
from .quality import compare_blocks
from .source import BLOCK_BYTES
from .truncated_svd import TruncatedSvd

COMPONENTS = 64
"""Of each channel, when nothing else is asked for."""

LINEAR, LOGARITHMIC = 0, 11
"""The colour models that are written: RGB, and log Y, U/Y, V/Y."""

Progress = Callable[[float, str], bool]

# Passes over the samples, of which two more would gain 0.03 dB on cloth; one measures the error.
_PASSES = 4
_HALF_LARGEST = 65504.0


@dataclass(frozen=True)
class _Factors:
    """One channel: values (k,), U (view * lights + light, k), SxV (texel, k)."""

    values: np.ndarray
    u: np.ndarray
    v: np.ndarray


def write_btf(
    dataset: Dataset,
    path: str | Path,
    *,
    components: int | Sequence[int] = COMPONENTS,
    colour_model: int = LINEAR,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Write a BTF to the file `path`; returns what came of it, JSON-able.

    `components` are those of each channel, or of three: red, green and blue of the colour model 0,
    which has the least squared error; Y, U and V of 11, in which errors look alike in the dark and
    in the light, and values below 0 become 0. Factors are half floats, or single ones where
    they are too large. Only a block of samples and the factors are ever in memory; the samples are
    read five times.

    Returned are `bytes`, `snr_db` (None when nothing is lost), `components` of each channel and
    `scalar`, "float16" or "float32".

    Raises NacreError for another kind of dataset, a direction below the surface, and when the file
    cannot be written; Cancelled when `progress` answers False. Then nothing is left of it, and an
    older file there is untouched.
    """
    path = Path(path)
    counts = _check(dataset, path, components, colour_model)
    model = ColourModel(colour_model, np.zeros(3), np.eye(3))
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")
    try:
        # First, since the work is long where it cannot be written.
        with partial.open("xb") as file:
            fitted = _factorise(dataset, counts, model, progress)
            factors = _rounded(fitted)
            quality = compare_blocks(_pairs(dataset, factors, model, progress))
            _write(file, dataset, factors, model)
        size = partial.stat().st_size
        os.replace(partial, path)
    except OSError as error:
        raise NacreError(f"cannot write {path}: {error.strerror}") from error
    finally:
        partial.unlink(missing_ok=True)
    return {
        "bytes": size,
        "snr_db": quality["snr_db"],
        "components": [len(factor.values) for factor in factors],
        "scalar": factors[0].u.dtype.name,
    }


def _check(
    dataset: Dataset, path: Path, components: int | Sequence[int], colour_model: int
) -> list[int]:
    """The components of each channel; NacreError for what cannot be written."""
    name = dataset.path.name
    if dataset.kind != "btf":
        raise NacreError(f"{name} is {dataset.kind}: .btf files hold BTFs")
    if dataset.channels != ("R", "G", "B"):
        raise NacreError(f"{name} has the channels {', '.join(dataset.channels)}, not R, G, B")
    if colour_model not in (LINEAR, LOGARITHMIC):
        raise NacreError(f"colour model {colour_model} is not written: choose 0 or 11")
    counts = [components] * 3 if isinstance(components, int) else list(components)
    if len(counts) != 3 or min(counts) < 1:
        raise NacreError(f"components must be a number from 1 on, or three, not {components}")
    if path.is_dir():
        raise NacreError(f"cannot write {path}: it is a folder")
    for axis, directions in (("light", dataset.light), ("view", dataset.view)):
        for index, theta in enumerate(unit_to_spherical(directions)[0]):
            if not is_above_horizon(theta):
                raise NacreError(
                    f"{name}: {axis} {index} has theta {theta:g}, below the surface: .btf files "
                    "hold no such directions"
                )
    return counts


# --- the factors ----------------------------------------------------------------------------------


def _factorise(
    dataset: Dataset, counts: list[int], model: ColourModel, progress: Progress | None
) -> list[_Factors]:
    lights, views, height, width, _ = dataset.shape
    channels = [TruncatedSvd(lights * views, height * width, count) for count in counts]
    for number in range(_PASSES):
        for light, some, block in _blocks(dataset, number, progress):
            rows = slice(some.start * lights + light, some.stop * lights, lights)
            for channel, plane in zip(channels, _encoded(block, model), strict=True):
                channel.add(rows, plane)
        if number < _PASSES - 1:
            for channel in channels:
                channel.end_pass()
    return [_Factors(*channel.factors()) for channel in channels]


def _blocks(
    dataset: Dataset, number: int, progress: Progress | None
) -> Iterator[tuple[int, slice, np.ndarray]]:
    """(light, views, samples (channel, view, texel) float32) of the pass of a number."""
    lights, views, height, width, channels = dataset.shape
    step = max(1, BLOCK_BYTES // (4 * height * width * channels))
    for light in range(lights):
        for first in range(0, views, step):
            done = (number + (light + first / views) / lights) / (_PASSES + 1)
            if progress is not None and not progress(done, f"Writing {dataset.path.name}"):
                raise Cancelled
            some = slice(first, min(first + step, views))
            samples = dataset.samples[light, some].reshape(-1, height * width, channels)
            yield light, some, np.moveaxis(samples, -1, 0).astype(np.float32, order="C")


def _encoded(planes: np.ndarray, model: ColourModel) -> np.ndarray:
    """Linear RGB (channel, ...) to what is factorised."""
    if model.number == LINEAR:
        return planes
    # Without negative values the ratios are bounded, down to black.
    positive = np.maximum(planes, 0)
    y, u, v = np.tensordot(np.linalg.inv(YUV_TO_RGB).astype(np.float32), positive, 1)
    shifted = y + LOG_OFFSET
    return np.stack([np.log(shifted), u / shifted, v / shifted])


def _rounded(fitted: list[_Factors]) -> list[_Factors]:
    """The factors as the file has them."""
    arrays = [array for factors in fitted for array in (factors.values, factors.u, factors.v)]
    fits = all(np.abs(array).max(initial=0) <= _HALF_LARGEST for array in arrays)
    scalar = np.dtype("<f2" if fits else "<f4")
    return [
        _Factors(*(array.astype(scalar) for array in (factors.values, factors.u, factors.v)))
        for factors in fitted
    ]


def _pairs(
    dataset: Dataset, factors: list[_Factors], model: ColourModel, progress: Progress | None
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Samples and what a reader makes of the factors."""
    lights = len(dataset.light)
    single = [(factor.u.astype(np.float32), factor.v.astype(np.float32)) for factor in factors]
    for light, some, block in _blocks(dataset, _PASSES, progress):
        rows = slice(some.start * lights + light, some.stop * lights, lights)
        yield block, model.decode(np.stack([u[rows] @ v.T for u, v in single]))
    if progress is not None and not progress(1.0, f"Writing {dataset.path.name}"):
        raise Cancelled


# --- the file -------------------------------------------------------------------------------------


def _write(file: BinaryIO, dataset: Dataset, factors: list[_Factors], model: ColourModel) -> None:
    _, _, height, width, _ = dataset.shape
    header = _header(dataset)
    file.write(b"!DFMF08FCR" + struct.pack("<I", 4 + len(header)) + header)
    file.write(_directions(dataset))
    file.write(struct.pack("<3I", width, height, 0))  # and no rotations
    most = max(len(factor.values) for factor in factors)
    file.write(struct.pack("<Ii12f", most, model.number, *model.mean, *model.matrix.flat))
    for factor in factors:
        (rows, count), columns = factor.u.shape, len(factor.v)
        file.write(struct.pack("<B3I", factor.u.dtype.itemsize, count, rows, columns))
        for array in (factor.values, factor.u, factor.v):
            file.write(np.ascontiguousarray(array).data)


def _header(dataset: Dataset) -> bytes:
    names = [text.encode("utf-8")[:79].ljust(80, b"\0") for text in ("Nacre", "", "")]
    pixels_per_mm = dataset.shape[3] / (1e3 * dataset.patch_size[0])
    data = struct.pack("<I", 4) + b"".join(names) + struct.pack("<4f", pixels_per_mm, 1, 1, 1)
    data += struct.pack("<3I", 1, 0, len(dataset.channels))  # the cosine is in; no XML
    return data + b"".join(struct.pack("<I", 1) + name.encode() for name in dataset.channels)


def _directions(dataset: Dataset) -> bytes:
    """Radians; the lights are repeated for each view."""
    light, view = (
        np.radians(np.stack(unit_to_spherical(directions), -1)).astype("<f4")
        for directions in (dataset.light, dataset.view)
    )
    lights = struct.pack("<I", len(light)) + light.tobytes()
    return struct.pack("<I", len(view)) + b"".join(row.tobytes() + lights for row in view)
