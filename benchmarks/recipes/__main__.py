"""Measure the recipes: `python -m benchmarks.recipes FOLDER [NAMES]`; what exists is skipped.

FOLDER gets NAME.nacre, a BTF at directions of the University of Bonn (81 x 81, or 151 x 151 with
`--directions ubo151`), or NAME_mask.npy, an occlusion mask uint8 (view, y, x), 1 covered; and a
contact sheet for each. The scenes of samples/ are measured where they are named.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from addon.datasets.direction_sets import direction_set
from addon.measure.occlusion import coverage

from .._measured import RECIPES, SCENES, TEXELS, measured, open_scene
from .sheet import btf_sheet, mask_sheet

MASKS = ("fibre_mask", "net_mask")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.recipes", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "names", nargs="*", choices=[*RECIPES, *MASKS, *SCENES, []], metavar="NAMES"
    )
    parser.add_argument("--directions", choices=("ubo81", "ubo151"), default="ubo81")
    parser.add_argument("--texels", type=int, default=TEXELS, help="along a side")
    parser.add_argument("--samples", type=int, help="paths a texel, instead of the recipe's own")
    parser.add_argument("--lights", type=int, help="so many, spread over the set, instead of all")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    view = light = direction_set(options.directions)
    if options.lights:
        light = light[np.linspace(0, len(light) - 1, options.lights).round().astype(int)]
    for name in options.names or [*RECIPES, *MASKS]:
        path = options.folder / (f"{name}.npy" if name in MASKS else f"{name}.nacre")
        if path.exists():
            continue
        begun = time.monotonic()
        if name in MASKS:
            with open_scene(name.removesuffix("_mask")) as patch:
                mask = coverage(patch, view, (options.texels, options.texels))
            np.save(path, np.round(mask).astype(np.uint8))
            mask_sheet(mask, path.with_suffix(".png"))
            found = f"{mask.mean():.1%} covered"
        else:
            dataset = measured(
                name, options.folder, options.directions, options.texels, options.samples, light
            )
            btf_sheet(dataset.samples, path.with_suffix(".png"))
            found = f"noise floor {dataset.noise_floor_db} dB"
        print(f"{name}: {found}, {time.monotonic() - begun:.0f} s", flush=True)


if __name__ == "__main__":
    main()
