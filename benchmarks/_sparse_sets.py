"""The materials that dictionaries are trained on, those that they never saw, and the training."""

from __future__ import annotations

import argparse
from pathlib import Path

from addon.datasets.dataset import Dataset
from addon.models.sparse.coding import code, measure
from addon.models.sparse.ensemble import Ensemble, choose
from addon.models.sparse.files import ensembles_of, load_ensemble, save_ensemble
from addon.models.sparse.model import SparseBtf
from addon.models.sparse.training import train

from ._data import OUT, materials
from ._measured import measured

TRAINING = ("studs", "roughhole", "lacquer", "woven_hair", "fibre", "translucent_wax")
UNSEEN = ("satin", "displaced_voronoi")
QUALITIES = (16, 32, 64, 128, 256)

# Texels along a side, paths a texel (None for the scene's own), and texels along a patch's side.
SETS = {"ubo81": (64, None, 8), "ubo151": (60, 4, 10)}

_SWEEPS = 8


def datasets(names: tuple[str, ...], folder: Path, directions: str) -> dict[str, Dataset]:
    """Of the folder, measured where they are not there: three to twenty minutes each on two cores;
    `python -m benchmarks.recipes` with these directions, texels and samples does the same."""
    texels, samples, _ = SETS[directions]
    return {name: measured(name, folder, directions, texels, samples) for name in names}


def parser(program: str, text: str | None) -> argparse.ArgumentParser:
    """The command line of a benchmark on these materials: their folder."""
    found = argparse.ArgumentParser(
        prog=f"python -m benchmarks.{program}",
        description=text,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    found.add_argument("folder", type=Path, nargs="?", default=OUT / "sparse")
    return found


def ensemble_path(count: int, folder: Path) -> Path:
    """Where `trained` keeps an ensemble."""
    return folder / f"ensemble K {count}.exr"


def trained(count: int, folder: Path, directions: str) -> Ensemble:
    """The ensemble of `count` dictionaries a part, out of its file where it is there."""
    path = ensemble_path(count, folder)
    if not path.is_file():
        side, state = SETS[directions][2], folder / f".ensemble K {count}.training"
        materials = list(datasets(TRAINING, folder, directions).values())
        found = train(materials, patch=(side, side), dictionaries=count, sweeps=_SWEEPS,
                      folder=folder, state=state, resume=state.exists())  # fmt: skip
        save_ensemble(found, path)
    return load_ensemble(path)


def wool() -> SparseBtf:
    """The sample in the dictionaries that Nacre comes with, at the highest quality."""
    dataset = materials(None, ["wool"])["wool"]
    return code(dataset, choose(ensembles_of([]), dataset), QUALITIES[-1])


def error(dataset: Dataset, model: SparseBtf, quality: int) -> float:
    """MSE of linear values at a quality, times 10^4."""
    return 1e4 * measure(dataset, model.truncated(quality))["mse"]
