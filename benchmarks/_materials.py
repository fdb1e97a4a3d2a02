"""Datasets to measure on: the wool sample, and larger ones made of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from addon.datasets.dataset import AXES, Dataset, DatasetWriter, open_dataset
from addon.datasets.importing import import_dataset

SAMPLE = Path(__file__).parent.parent / "samples" / "wool_W64xH64_L81xV81.btf"


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
    description = {
        "nacre": 1,
        "kind": source.kind,
        "axes": list(AXES),
        "light": source.light.tolist(),
        "view": source.view.tolist(),
        "channels": list(source.channels),
        "patch_size": [2 * length for length in source.patch_size],
        "periodic": False,
        "noise_floor_db": None,
        "source": source.source,
    }
    path = Path(folder) / f"patchwork{size}.nacre"
    shape = (*source.shape[:2], size, size, 3)
    with DatasetWriter(path, description, shape, np.float16) as writer:
        for light in range(shape[0]):
            a = np.maximum(np.asarray(source.samples[light], np.float32), 0)
            transposed = np.sqrt(a.swapaxes(1, 2)[..., ::-1])
            product = a * np.roll(a, (17, 29), (1, 2))
            upper = np.concatenate([a, np.minimum(a[:, :, ::-1] ** 1.5, 100)], axis=2)
            lower = np.concatenate([transposed, np.minimum(product, 100)], axis=2)
            writer.write(np.concatenate([upper, lower], axis=1)[:, :size, :size])
    return open_dataset(path)
