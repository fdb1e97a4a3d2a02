"""Compressed measurements against Cycles on the real geometry, at directions off the grid.

    python -m benchmarks.off_grid [FOLDER] [--only SCENES]

The scenes of samples/ are measured at 81 x 81 directions and 64 x 64 texels and compressed with
MK-CTA into FOLDER, unless they are there already, which takes about an hour. For eight pairs of
light and view between the measured ones, off_grid.png shows the patch as Cycles renders it with
many samples, as EEVEE shows the model's material, and their FLIP error. Printed are PSNR and FLIP
of the material, and of the uncompressed dataset interpolated by a thin-plate spline: what is lost
between the measured directions, and not by compression.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from addon.datasets.dataset import Dataset
from addon.datasets.directions import spherical_to_unit
from addon.measure.cycles import add_light, aim
from addon.measure.instrument import new_instrument
from addon.measure.patch import open_patch
from addon.models.clustered_tucker import ClusteredTucker
from addon.models.exr import load_model, save_model
from addon.models.fit import compress, quality_settings
from addon.models.interpolation import thin_plate_weights
from addon.nodes.material import material_from_tables
from addon.render.engines import render_pixels
from addon.render.pictures import flat_scene
from addon.tables.tables import build_tables

from ._data import OUT
from ._measured import SCENES, measured
from ._object_pictures import build
from ._report import table
from ._scores import Pixels, score, srgb

METHOD, QUALITY = "mkcta", "HIGH"
SAMPLES = 256
ZOOM = 2
# (theta, phi) in degrees: between the rings of the 81 directions, and between their neighbours.
LIGHTS = [(7, 30), (22, 75), (38, 200), (52, 310), (66, 40), (37, 130), (52, 170), (24, 260)]
VIEWS = [(22, 200), (38, 310), (7, 100), (37, 55), (22, 280), (66, 250), (53, 20), (67, 150)]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.off_grid", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=OUT / "off_grid")
    parser.add_argument("--only", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--samples", type=int, default=SAMPLES, help="of the reference")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    light, view = (spherical_to_unit(*zip(*pairs, strict=True)) for pairs in (LIGHTS, VIEWS))
    strips = []
    for scene in options.only:
        name = SCENES[scene][0]
        dataset, model = compressed(scene, options.folder)
        truth = [srgb(p) for p in in_cycles(scene, dataset, light, view, options.samples)]
        seen = [srgb(p) for p in in_eevee(scene, model)]
        between = [srgb(p) for p in interpolated(dataset, light, view)]
        of_model, of_samples = ([score(a, b) for a, b in zip(truth, s, strict=True)]
                                for s in (seen, between))  # fmt: skip
        rows = [["light", *(f"{t},{p}" for t, p in LIGHTS), "mean"]]
        rows.append(["view", *(f"{t},{p}" for t, p in VIEWS), ""])
        for label, found in (("model", of_model), ("dataset", of_samples)):
            for measure, form in (("PSNR", "{:.1f}"), ("FLIP", "{:.3f}")):
                values = [one[measure] for one in found]
                cells = [form.format(value) for value in [*values, np.mean(values)]]
                rows.append([f"{label}, {measure}", *cells])
        fit = model.fit["snr_db"]
        size = (options.folder / f"{scene}.exr").stat().st_size
        print(f"\n{name}: {dataset.raw_bytes / 1e6:.0f} MB of samples in {size / 1e6:.2f} MB, "
              f"SNR {fit:.1f} dB on the grid, noise floor {dataset.noise_floor_db} dB")  # fmt: skip
        print(table(rows))
        strips += [truth, seen, [one["map"] for one in of_model]]
    picture = np.concatenate([np.concatenate(strip, 1) for strip in strips], 0)
    size = picture.shape[1] * ZOOM, picture.shape[0] * ZOOM
    image = Image.fromarray(np.round(picture * 255).astype(np.uint8))
    image.resize(size, Image.Resampling.NEAREST).save(options.folder / "off_grid.png")


def compressed(scene: str, folder: Path) -> tuple[Dataset, ClusteredTucker]:
    """The dataset and the model of a scene, made where they are not there."""
    dataset, file = measured(scene, folder), folder / f"{scene}.exr"
    if not file.is_file():
        save_model(compress(dataset, METHOD, **quality_settings(dataset, METHOD, QUALITY)), file)
    return dataset, load_model(file)


def in_cycles(scene_name: str, dataset, light, view, samples: int) -> list[Pixels]:
    """The patch (y, x, 3), linear, for each pair of light and view, without the dataset's noise."""
    texels = dataset.shape[3], dataset.shape[2]
    bounces = dataset.source["measurement"]["bounces"]
    found = []
    with open_patch(build(scene_name), dataset.patch_size) as patch:
        for one_light, one_view in zip(light, view, strict=True):
            directions = one_view[None], one_light[None]
            with new_instrument(patch, *directions, texels, samples, bounces) as instrument:
                aim(add_light(instrument.scene), one_light)
                # Other seeds than the dataset's: it is not to share the noise.
                found.append(instrument.picture(2**20)[0, ..., :3])
    return found


def in_eevee(name: str, model: ClusteredTucker) -> list[Pixels]:
    """The model's material (y, x, 3), linear, for each pair of light and view."""
    _, _, height, width, _ = model.shape
    material = material_from_tables(build_tables(model), name)
    found = []
    with flat_scene(material, (width, height), "eevee") as flat:
        for light, view in zip(LIGHTS, VIEWS, strict=True):
            flat.aim(light, view)
            found.append(render_pixels(flat.scene))
    return found


def interpolated(dataset, light, view) -> list[Pixels]:
    """The samples (y, x, 3) at each pair of light and view."""
    of_light = thin_plate_weights(dataset.light, light).astype(np.float32)
    of_view = thin_plate_weights(dataset.view, view).astype(np.float32)
    lit = np.zeros((len(light), *dataset.shape[1:]), np.float32)
    for number, samples in enumerate(dataset.samples):
        lit += of_light[:, number, None, None, None, None] * np.asarray(samples, np.float32)
    return [np.tensordot(of_view[i], lit[i], 1) for i in range(len(light))]


if __name__ == "__main__":
    main()
