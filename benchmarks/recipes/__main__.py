"""Measure the recipes: `python -m benchmarks.recipes FOLDER [NAMES]`; what exists is skipped.

FOLDER gets NAME.nacre, a BTF at directions of the University of Bonn (81 x 81, or 151 x 151 with
`--directions ubo151`), or NAME_mask.npy, an occlusion mask uint8 (view, y, x), 1 covered; and a
contact sheet for each. The scenes of samples/ are measured where they are named.
"""

from __future__ import annotations

import argparse
import importlib
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from addon.datasets.dataset import Dataset, open_dataset
from addon.datasets.direction_sets import direction_set
from addon.measure.btf import measure_btf
from addon.measure.occlusion import coverage
from addon.measure.patch import Patch, open_patch
from addon.measure.settings import Settings

from .._object_pictures import build
from ..off_grid import SCENES
from .sheet import btf_sheet, mask_sheet

# Name of the result: paths a texel.
BTFS = {"studs": 16, "roughhole": 8, "fibre": 8, "satin": 8, "lacquer": 8}
MASKS = ("fibre_mask", "net_mask")
TEXELS = 64


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.recipes", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", choices=[*BTFS, *MASKS, *SCENES, []], metavar="NAMES")
    parser.add_argument("--directions", choices=("ubo81", "ubo151"), default="ubo81")
    parser.add_argument("--texels", type=int, default=TEXELS, help="along a side")
    parser.add_argument("--samples", type=int, help="paths a texel, instead of the recipe's own")
    parser.add_argument("--lights", type=int, help="so many, spread over the set, instead of all")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    view = light = direction_set(options.directions)
    if options.lights:
        light = light[np.linspace(0, len(light) - 1, options.lights).round().astype(int)]
    for name in options.names or [*BTFS, *MASKS]:
        path = options.folder / (f"{name}.npy" if name in MASKS else f"{name}.nacre")
        if path.exists():
            continue
        begun = time.monotonic()
        if name in MASKS:
            with _patch(name) as patch:
                mask = coverage(patch, view, (options.texels, options.texels))
            np.save(path, np.round(mask).astype(np.uint8))
            mask_sheet(mask, path.with_suffix(".png"))
            found = f"{mask.mean():.1%} covered"
        else:
            dataset = measured(
                options.folder, name, options.directions, options.texels, options.samples, light
            )
            btf_sheet(dataset.samples, path.with_suffix(".png"))
            found = f"noise floor {dataset.noise_floor_db} dB"
        print(f"{name}: {found}, {time.monotonic() - begun:.0f} s", flush=True)


def measured(
    folder: Path,
    name: str,
    directions: str = "ubo81",
    texels: int = TEXELS,
    samples: int | None = None,
    light: np.ndarray | None = None,
) -> Dataset:
    """A BTF of a recipe or of a scene of samples/, measured where it is not in the folder.

    `samples` are its own and `light` the named directions unless given."""
    path = folder / f"{name}.nacre"
    if path.is_dir():
        return open_dataset(path)
    folder.mkdir(parents=True, exist_ok=True)
    view = direction_set(directions)
    own, bounces = (BTFS[name], 2) if name in BTFS else _scene_settings(name)
    settings = Settings(texels, samples or own, bounces=bounces)
    with _patch(name) as patch:
        return measure_btf(patch, path, view if light is None else light, view, settings)


def _scene_settings(name: str) -> tuple[int, int]:
    settings = SCENES[name][2]
    return settings.samples, settings.bounces


@contextmanager
def _patch(name: str) -> Iterator[Patch]:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if name in SCENES:
        with open_patch(build(name), SCENES[name][1]) as patch:
            yield patch
    else:
        recipe = importlib.import_module(f".{name.removesuffix('_mask')}", __package__)
        yield recipe.build()


if __name__ == "__main__":
    main()
