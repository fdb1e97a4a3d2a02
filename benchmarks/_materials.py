"""Datasets to measure on: the wool sample, and larger ones made of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from addon.datasets.dataset import AXES, Dataset, DatasetWriter, open_dataset
from addon.datasets.directions import spherical_to_unit
from addon.datasets.importing import import_dataset

SAMPLE = Path(__file__).parent.parent / "samples" / "wool_W64xH64_L81xV81.btf"

RINGS = {0: 1, 11: 6, 23.5: 12, 30: 12, 37.5: 12, 45: 18, 52.5: 18, 60: 24, 67.5: 24, 75: 24}
"""UBO2014's 151 directions: polar angle and how many azimuths."""


def wool(folder: str | Path) -> Dataset:
    """The measured wool, 81x81x64x64 RGB half floats."""
    return import_dataset(SAMPLE, Path(folder) / "wool.nacre")


def patchwork(folder: str | Path, size: int) -> Dataset:
    """81x81 x size x size RGB, size at most 128: a corner of four patches that differ.

    The wool; its mirror image with more contrast; its transpose with less, red and blue exchanged;
    and its product with a shifted copy. So the larger tensor has structure of its own, which plain
    repetition would not give it.
    """
    source = wool(folder)
    size_of_patch = [2 * length for length in source.patch_size]
    description = _description(source, source.light, source.view, size_of_patch)
    path = Path(folder) / f"patchwork{size}.nacre"
    shape = (*source.shape[:2], size, size, 3)
    with DatasetWriter(path, description, shape, np.float16) as writer:
        for light in range(shape[0]):
            images = np.maximum(np.asarray(source.samples[light], np.float32), 0)
            writer.write(patches(images)[:, :size, :size])
    return open_dataset(path)


def patches(images: NDArray[np.float32]) -> NDArray[np.float32]:
    """Square images (view, n, n, channel) made into (view, 2 n, 2 n, channel), see `patchwork`."""
    contrast = np.minimum(images[:, :, ::-1] ** 1.5, 100)
    transposed = np.sqrt(images.swapaxes(1, 2)[..., ::-1])
    product = np.minimum(images * np.roll(images, (17, 29), (1, 2)), 100)
    upper = np.concatenate([images, contrast], axis=2)
    return np.concatenate([upper, np.concatenate([transposed, product], axis=2)], axis=1)


def denser(folder: str | Path) -> Dataset:
    """The wool at 151x151 directions, 64x64 RGB: each direction mixes its three nearest ones.

    Weights are inverse squared distances; a little of each texel's neighbour, more with each ring,
    keeps the new images from lying in the span of the old.
    """
    source = wool(folder)
    directions = np.concatenate(
        [
            spherical_to_unit(np.full(count, theta), np.arange(count) * 360 / count)
            for theta, count in RINGS.items()
        ]
    )
    light, view = _mixing(directions, source.light), _mixing(directions, source.view)
    shifted = np.linspace(0, 0.5, len(directions), dtype=np.float32)[:, None, None, None]
    path = Path(folder) / "denser.nacre"
    shape = (len(directions), len(directions), *source.shape[2:])
    description = _description(source, directions, directions, source.patch_size)
    with DatasetWriter(path, description, shape, np.float16) as writer:
        for row in light:
            near = np.flatnonzero(row)
            image = np.tensordot(row[near], np.asarray(source.samples[near], np.float32), (0, 0))
            images = np.tensordot(view, np.maximum(image, 0), (1, 0))
            writer.write((1 - shifted) * images + shifted * np.sqrt(images * np.roll(images, 1, 2)))
    return open_dataset(path)


def _mixing(directions: NDArray[np.float64], known: NDArray[np.float64]) -> NDArray[np.float32]:
    """Weights (directions, known) of the three nearest known directions, which sum to 1."""
    squared = np.square(directions[:, None] - known[None]).sum(2) + 1e-6
    weights = 1 / squared
    weights[squared > np.sort(squared, axis=1)[:, 2:3]] = 0
    return (weights / weights.sum(1, keepdims=True)).astype(np.float32)


def _description(
    source: Dataset,
    light: NDArray[np.float64],
    view: NDArray[np.float64],
    patch_size: Sequence[float],
) -> dict[str, Any]:
    return {
        "nacre": 1,
        "kind": source.kind,
        "axes": list(AXES),
        "light": light.tolist(),
        "view": view.tolist(),
        "channels": list(source.channels),
        "patch_size": list(patch_size),
        "periodic": False,
        "noise_floor_db": None,
        "source": source.source,
    }
