"""The files of the paper's authors: ensembles, direction tables, codes, means and deviations.

github.com/behnazkavoosi/SparseBTF. Everything is little-endian; there are 151 lights and views,
whose angle is the elevation above the horizon. Their y grows downward, ours upward.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ...errors import NacreError
from .ensemble import Ensemble, largest_misfit, orthonormal
from .transform import CHANNELS, Normalisation

PATCH, ANGLES, DICTIONARIES = 10, 151, 8
OFFSET = 1e-5
_SHAPE = (PATCH, PATCH, ANGLES, ANGLES)  # x, y, light, view
_SIDE = 40  # patches along x and y
_HALF_MISFIT = 2e-3  # orthonormality of half floats


def is_authors_folder(path: Path) -> bool:
    """Whether a folder has the authors' layout."""
    return (path / "bonn_angles.bin").is_file()


def load_authors_ensemble(folder: Path) -> Ensemble:
    """The trained ensembles for Y, U and V; NacreError when a file is missing or damaged."""
    angles = _read(folder / "bonn_angles.bin", "<f8", 3 * ANGLES).reshape(3, ANGLES)
    azimuth, elevation = angles[0], angles[1]
    across = np.cos(elevation)
    directions = np.stack(
        [across * np.cos(azimuth), across * np.sin(azimuth), np.sin(elevation)], -1
    )
    dictionaries = {}
    for key in CHANNELS:
        path = folder / "dictionaries" / f"DictEnsOrth4D{key}.bin"
        count = DICTIONARIES * sum(size * size for size in _SHAPE)
        values = _read(path, "<f2", count).astype(np.float64)
        modes, start = [], 0
        for size in _SHAPE:
            end = start + DICTIONARIES * size * size
            # Column by column.
            modes.append(values[start:end].reshape(-1, size, size).transpose(0, 2, 1))
            start = end
        if not largest_misfit(modes) < _HALF_MISFIT:
            raise NacreError(f"{path}: holds matrices that are not orthonormal; copy it again")
        x, y, light, view = (orthonormal(matrices) for matrices in modes)
        dictionaries[key] = (np.ascontiguousarray(y[:, ::-1]), x, light, view)
    return Ensemble(
        patch=(PATCH, PATCH),
        light=directions,
        view=directions,
        dictionaries=dictionaries,
        offset=OFFSET,
        by_deviation=True,
        training={"by": "Kavoosighafi et al. 2023", "sparsity": {"Y": 256, "U": 32, "V": 32}},
    )


def load_authors_codes(
    path: Path,
) -> tuple[NDArray[np.uint32], NDArray[np.float32], NDArray[np.uint32]]:
    """Codes of one channel: positions and values (patches, coefficients), members (patches,).

    Positions are in C order of y, x, light, view; patches row by row from the lower left.
    """
    try:
        words = np.fromfile(path, "<u2")
    except OSError as error:
        raise NacreError(f"{path}: cannot be read ({error.strerror})") from error
    count = _SIDE * _SIDE
    sparsity, rest = divmod(len(words) - 4 - 2 * count, 5 * count)
    if rest or sparsity < 1 or tuple(words[:4]) != _SHAPE:
        raise NacreError(f"{path}: not sparse codes of {count} patches of 10 x 10 texels")
    places, members, _, values = np.split(
        words[4:], np.cumsum([4 * sparsity * count, count, count])
    )
    x, y, light, view = places.reshape(count, sparsity, 4).astype(np.int64).transpose(2, 0, 1)
    modes = (y, x, light, view)
    if any(int(mode.max()) >= size for mode, size in zip((x, y, light, view), _SHAPE, strict=True)):
        raise NacreError(f"{path}: has positions outside the patch; copy it again")
    if int(members.max()) >= DICTIONARIES:
        raise NacreError(f"{path}: names a dictionary that is not there; copy it again")
    positions = np.ravel_multi_index(modes, (PATCH, PATCH, ANGLES, ANGLES)).astype(np.uint32)
    upward = np.arange(count).reshape(_SIDE, _SIDE)[::-1].ravel()
    numbers = values.view("<f2").reshape(count, sparsity).astype(np.float32)
    return positions[upward], numbers[upward], members[upward].astype(np.uint32)


def load_authors_normalisation(path: Path) -> Normalisation:
    """Means and deviations of a material's images."""
    both = _read(path, "<f8", 2 * ANGLES * ANGLES).reshape(2, ANGLES, ANGLES)
    mean, deviation = both.transpose(0, 2, 1).astype(np.float32)  # they have the view first
    # Theirs is of log(RGB + offset): of a constant more in Y.
    shift = np.array([np.log(OFFSET), 0.0, 0.0], np.float32)
    return Normalisation(mean[..., None] - shift, deviation, OFFSET)


def _read(path: Path, kind: DTypeLike, count: int) -> NDArray[np.floating]:
    try:
        values = np.fromfile(path, kind)
    except OSError as error:
        raise NacreError(f"{path}: cannot be read ({error.strerror})") from error
    if len(values) != count:
        raise NacreError(f"{path}: has {len(values)} numbers and {count} were expected")
    if not np.isfinite(values).all():
        raise NacreError(f"{path}: has numbers that are not finite")
    return values
