"""Measure the recipes: `python -m benchmarks.recipes FOLDER [NAMES]`; what exists is skipped.

FOLDER gets NAME.nacre, a BTF at the 81 x 81 directions of the University of Bonn, or
NAME_mask.npy, an occlusion mask uint8 (view, y, x), 1 covered; and a contact sheet for each.
"""

from __future__ import annotations

import argparse
import importlib
import time
from pathlib import Path

import bpy
import numpy as np

from addon.datasets.direction_sets import ubo_81
from addon.measure.btf import measure_btf
from addon.measure.occlusion import coverage
from addon.measure.settings import Settings

from .sheet import btf_sheet, mask_sheet

# Name of the result: paths a texel.
BTFS = {"studs": 16, "roughhole": 8, "fibre": 8, "satin": 8, "lacquer": 8}
MASKS = ("fibre_mask", "net_mask")
TEXELS = 64


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.recipes", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", choices=[*BTFS, *MASKS, []], metavar="NAMES")
    parser.add_argument("--texels", type=int, default=TEXELS, help="along a side")
    parser.add_argument("--samples", type=int, help="paths a texel, instead of the recipe's own")
    parser.add_argument("--lights", type=int, help="so many, spread over the 81, instead of all")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    view = light = ubo_81()
    if options.lights:
        light = light[np.linspace(0, len(light) - 1, options.lights).round().astype(int)]
    for name in options.names or [*BTFS, *MASKS]:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        recipe = importlib.import_module(f".{name.removesuffix('_mask')}", __package__)
        patch = recipe.build()
        path = options.folder / (f"{name}.npy" if name in MASKS else f"{name}.nacre")
        if path.exists():
            continue
        begun = time.monotonic()
        if name in MASKS:
            mask = coverage(patch, view, (options.texels, options.texels))
            np.save(path, np.round(mask).astype(np.uint8))
            mask_sheet(mask, path.with_suffix(".png"))
            found = f"{mask.mean():.1%} covered"
        else:
            samples = options.samples or BTFS[name]
            settings = Settings(options.texels, samples, bounces=2)
            dataset = measure_btf(patch, path, light, view, settings)
            btf_sheet(dataset.samples, path.with_suffix(".png"))
            found = f"noise floor {dataset.noise_floor_db} dB"
        print(f"{name}: {found}, {time.monotonic() - begun:.0f} s", flush=True)


if __name__ == "__main__":
    main()
