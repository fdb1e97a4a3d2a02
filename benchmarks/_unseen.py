"""The materials that dictionaries are trained on and those that they never saw, at the 151 x 151
directions of UBO2014."""

from __future__ import annotations

from pathlib import Path

from addon.datasets.dataset import Dataset
from addon.models.sparse.coding import measure
from addon.models.sparse.model import SparseBtf

from ._measured import measured

TRAINING = ("studs", "roughhole", "lacquer", "woven_hair", "fibre", "translucent_wax")
UNSEEN = ("satin", "displaced_voronoi")
PATCH = (10, 10)
_TEXELS, _SAMPLES = 60, 4


def datasets(names: tuple[str, ...], folder: Path) -> dict[str, Dataset]:
    """Of the folder, measured where they are not there: five to twenty minutes each on two cores;
    `python -m benchmarks.recipes` with these directions, texels and samples does the same."""
    return {name: measured(name, folder, "ubo151", _TEXELS, _SAMPLES) for name in names}


def error(dataset: Dataset, model: SparseBtf, quality: int) -> float:
    """MSE of linear values at a quality, times 10^4."""
    return 1e4 * measure(dataset, model.truncated(quality))["mse"]
