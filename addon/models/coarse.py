"""Coarse to fine: a first guess from the spatially downsampled samples (MK-CTA, Section 5.2).

Large spatial modes that are not global make every iteration dear. A fit of averaged texels finds
clusters and bases at a fraction of the cost; upsampled, they start the fit of the full samples.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import nacre_native
import numpy as np
from numpy.typing import NDArray

_SPATIAL = (2, 3)  # modes y and x


class _GlobalsFound(Exception):
    """Stops a fit that has its global bases."""


def coarse_start(
    samples: NDArray[Any],
    ranks: Sequence[int],
    factor: int,
    *,
    folder: str | None,
    directions: dict[int, NDArray[np.float64]],
    global_modes: tuple[int, ...],
    progress: Callable[[float, str], bool] | None,
    **settings: Any,
) -> dict[str, Any] | None:
    """A model to start `nacre_native.fit_clustered` from, in its own layout.

    samples (light, view, y, x, channel); `factor` texels along each spatial mode that is not global
    become one. Other arguments as of fit_clustered. None if nothing can be averaged: the mode is
    global or would be left with fewer rows than its rank, or, clustered, than its clusters.
    """
    least = {mode: max(ranks[mode], settings["clusters"].get(mode, 1)) for mode in _SPATIAL}
    modes = [
        mode
        for mode in _SPATIAL
        if mode not in global_modes and samples.shape[mode] // factor >= least[mode]
    ]
    if not modes:
        return None
    shared = {"global_modes": global_modes, **settings}
    start = None
    if global_modes:  # these stay as they are, so they are those of the full samples
        found: list[dict[str, Any]] = []

        def keep(state: dict[str, Any]) -> None:
            found.append(state)
            raise _GlobalsFound

        try:
            nacre_native.fit_clustered(
                samples, ranks, directions=directions, checkpoint=keep, progress=progress, **shared
            )
        except _GlobalsFound:
            start = {**found[0], "passes": 0.0}
    with tempfile.TemporaryDirectory(dir=folder) as name:
        small = _averaged(samples, modes, factor, Path(name) / "coarse")
        places = {
            mode: rows[: small.shape[mode]] if mode in modes else rows
            for mode, rows in directions.items()
        }
        fitted = nacre_native.fit_clustered(
            small, ranks, directions=places, start=start, progress=progress, **shared
        )
    model: dict[str, Any] = {**fitted}
    for mode in modes:
        _upsample(model, mode, samples.shape[mode], factor)
    return {**model, "errors": []}


def _averaged(samples: NDArray[Any], modes: list[int], factor: int, path: Path) -> NDArray[Any]:
    """Samples with each whole group of `factor` rows of these modes averaged, on disk."""
    shape = [size // factor if n in modes else size for n, size in enumerate(samples.shape)]
    small = np.memmap(path, samples.dtype, "w+", shape=tuple(shape))
    for light in range(shape[0]):
        block = samples[light].astype(np.float32)
        for mode in modes:
            axis = mode - 1  # without the light
            count = shape[mode]
            block = np.take(block, np.arange(count * factor), axis)
            split = (*block.shape[:axis], count, factor, *block.shape[axis + 1 :])
            block = block.reshape(split).mean(axis + 1)
        small[light] = block
    return small


def _upsample(model: dict[str, Any], mode: int, size: int, factor: int) -> None:
    """Bring the basis of one mode to `size` rows, orthonormal again, the rest into the core."""
    basis = model["basis"][mode]
    place = (np.arange(size) + 0.5) / factor - 0.5
    if mode in model["members"]:  # rows of different clusters do not mix
        nearest = np.clip(np.round(place), 0, basis.shape[1] - 1).astype(int)
        model["basis"][mode] = np.ascontiguousarray(basis[:, nearest])
        model["members"][mode] = np.ascontiguousarray(model["members"][mode][nearest])
        return
    rows = np.arange(basis.shape[1])
    upsampled = np.empty((len(basis), size, 1, basis.shape[3]), np.float32)
    for owner, columns in enumerate(basis[:, :, 0]):
        wide = np.stack([np.interp(place, rows, column) for column in columns.T], 1)
        upsampled[owner, :, 0], change = np.linalg.qr(wide)
        core = model["core"][owner]
        model["core"][owner] = np.moveaxis(np.tensordot(change, core, (1, mode)), 0, mode)
    model["basis"][mode] = upsampled
