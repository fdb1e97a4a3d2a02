"""BTFs of the recipes and of the scenes of samples/, measured where they are not there."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from addon.datasets.dataset import Dataset, open_dataset
from addon.datasets.direction_sets import direction_set
from addon.measure.btf import measure_btf
from addon.measure.patch import Patch, open_patch
from addon.measure.settings import Settings

from ._object_pictures import build

TEXELS = 64

RECIPES = {"studs": 16, "roughhole": 8, "fibre": 8, "satin": 8, "lacquer": 8}
"""Paths a texel."""

# Of each scene: its name for people, the patch's size in metres, None for the object's own, and how
# it is measured.
SCENES = {
    "woven_hair": ("Weave", (0.012, 0.012), Settings(TEXELS, 8, bounces=3)),
    "displaced_voronoi": ("Scales", (0.02, 0.02), Settings(TEXELS, 16, bounces=3)),
    "translucent_wax": ("Wax", None, Settings(TEXELS, 8, bounces=4)),
}


def measured(
    name: str,
    folder: Path,
    directions: str = "ubo81",
    texels: int = TEXELS,
    samples: int | None = None,
    light: np.ndarray | None = None,
) -> Dataset:
    """FOLDER/NAME.nacre. `samples` are its own and `light` the named directions unless given."""
    path = folder / f"{name}.nacre"
    if path.is_dir():
        return open_dataset(path)
    folder.mkdir(parents=True, exist_ok=True)
    view = direction_set(directions)
    usual = SCENES[name][2] if name in SCENES else Settings(TEXELS, RECIPES[name], bounces=2)
    settings = Settings(texels, samples or usual.samples, bounces=usual.bounces)
    with open_scene(name) as patch:
        return measure_btf(patch, path, view if light is None else light, view, settings)


@contextmanager
def open_scene(name: str) -> Iterator[Patch]:
    """The patch of a scene of samples/, or of a module of benchmarks/recipes."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if name in SCENES:
        with open_patch(build(name), SCENES[name][1]) as patch:
            yield patch
    else:
        yield importlib.import_module(f".recipes.{name}", __package__).build()
