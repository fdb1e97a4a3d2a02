"""Objects of measured materials against Cycles on the real geometry.

    python -m benchmarks.truth [FOLDER] [--only SCENES]

The scenes of samples/, bent on to a sphere and a cloth, under a sun, four suns and one of Blender's
studio worlds. FOLDER is that of benchmarks.off_grid and holds their measurements, which are made
where they are not there; so are the pictures and models, in FOLDER/truth. Printed are PSNR, SSIM and
FLIP of the uncompressed dataset on the smooth mesh and of models of about the same size, over the
pixels that the smooth mesh fills, and the bar: the default model's FLIP is at most 0.02 above
the dataset's. truth.png shows them all.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from addon.datasets.dataset import Dataset

from ._data import OUT
from ._lights import LIGHTS
from ._object_pictures import Pixels, Shot, build, in_cycles
from .off_grid import SCENES, measured_dataset

SIZE = 320
CAMERA = (25.0, -60.0)
ACROSS = {"sphere": 5, "cloth": 4}  # so that a texel is about a pixel
SAMPLES = {"woven_hair": 64, "displaced_voronoi": 64, "translucent_wax": 128}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.truth", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=OUT / "off_grid")
    parser.add_argument("--only", nargs="+", choices=SCENES, default=list(SCENES))
    options = parser.parse_args()
    own = options.folder / "truth"
    own.mkdir(parents=True, exist_ok=True)
    for scene in options.only:
        dataset = measured_dataset(scene, options.folder)
        for kind in ACROSS:
            shot = Shot(kind, ACROSS[kind], SIZE, CAMERA)
            truth = rendered(scene, dataset, shot, own)


def rendered(scene: str, dataset: Dataset, shot: Shot, folder: Path) -> dict[str, Pixels]:
    """Cycles' pictures (y, x, 4) by the lights, made where they are not in the folder."""

    def path(lights: str) -> Path:
        return folder / f"{scene} {shot.object} {lights} {shot.size} {SAMPLES[scene]}.npy"

    missing = [lights for lights in LIGHTS if not path(lights).is_file()]
    if missing:
        in_cycles(
            build(scene), dataset, shot, missing, SAMPLES[scene],
            lambda lights, picture: np.save(path(lights), picture),
        )  # fmt: skip
    return {lights: np.load(path(lights)) for lights in LIGHTS}


if __name__ == "__main__":
    main()
