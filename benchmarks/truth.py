"""Objects of measured materials against Cycles on the real geometry.

    python -m benchmarks.truth [FOLDER] [--only SCENES] [--quality QUALITY] [--engines]

The scenes of samples/, bent on to a sphere and a cloth, under a sun, four suns and one of Blender's
studio worlds. FOLDER is that of benchmarks.off_grid and holds their measurements, which are made
where they are not there; so are the pictures and models, in FOLDER/truth. Printed are PSNR, SSIM
and FLIP of the uncompressed dataset on the smooth mesh and of models of about the same size, over
the pixels that the smooth mesh fills, and the bar: the default model's FLIP is at most 0.02 above
the dataset's. truth.png shows them all.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from addon.datasets.dataset import Dataset
from addon.models.clustered_tucker import ClusteredTucker
from addon.models.exr import load_model, save_model
from addon.models.fit import METHODS, QUALITIES, QUALITY, quality_settings
from addon.models.lightness import compress_by_lightness
from addon.nodes.material import material_from_tables
from addon.render.engines import render_pixels
from addon.render.pictures import object_scene
from addon.tables.tables import Tables, build_tables

from ._data import OUT
from ._lights import LIGHTS, SUNS, light_scene, lights
from ._measured import SCENES, measured
from ._object_pictures import (
    Pixels,
    Shot,
    View,
    build,
    look_at,
    of_dataset,
    of_tables,
    real_scene,
    remove_lights,
    take,
)
from ._report import bar, table
from ._scores import score, srgb

SIZE = 320
CAMERA = (25.0, -60.0)
ACROSS = {"sphere": 5, "cloth": 4}  # so that a texel is about a pixel
SAMPLES = {"woven_hair": 64, "displaced_voronoi": 64, "translucent_wax": 128}
DEFAULT = "kcta", QUALITY
TITLES = {"dataset": "dataset", "nsvd": "N-SVD", "cta": "CTA", "kcta": "K-CTA", "mkcta": "MK-CTA"}
ALLOWED = 0.02
TILE = 112
ENGINES = "eevee", "cycles"
ENGINE_METHODS = "kcta", "mkcta"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.truth", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=OUT / "off_grid")
    parser.add_argument("--only", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--quality", choices=QUALITIES, default=DEFAULT[1])
    parser.add_argument("--engines", action="store_true", help="compare the nodes, too")
    options = parser.parse_args()
    own = options.folder / "truth"
    own.mkdir(parents=True, exist_ok=True)
    rows, strips, above = [], [], []
    for scene in options.only:
        dataset = measured(scene, options.folder)
        files = fitted(scene, dataset, options.quality, own)
        sizes = ", ".join(f"{TITLES[m]} {f.stat().st_size / 1e6:.2f} MB" for m, f in files.items())
        print(
            f"{SCENES[scene][0]}: {dataset.raw_bytes / 1e6:.0f} MB of samples; {sizes}", flush=True
        )
        models = {method: load_model(file) for method, file in files.items()}
        for method in ENGINE_METHODS if options.engines else ():
            far = in_engines(build_tables(models[method]), dataset)
            text = ", ".join(f"{engine} {value:.2%}" for engine, value in far.items())
            print(f"  {TITLES[method]} by nodes, from the tables on the CPU: {text}", flush=True)
        for kind in ACROSS:
            shot = Shot(kind, ACROSS[kind], SIZE, CAMERA)
            truth = rendered(scene, dataset, shot, own)
            view = look_at(dataset, shot)
            prefix = own / f"{scene} {kind} {SIZE}"
            seen = on_smooth_mesh(dataset, models, view, partial(kept, prefix, options.quality))
            for light in LIGHTS:
                scores, strip = compared(truth[light], seen[light], view)
                strips.append((f"{SCENES[scene][0]}, {kind}, {light}", strip))
                above.append(scores[DEFAULT[0]]["FLIP"] - scores["dataset"]["FLIP"])
                for measure, form in (("PSNR", "{:.1f}"), ("SSIM", "{:.3f}"), ("FLIP", "{:.3f}")):
                    first = [SCENES[scene][0], kind, light] if measure == "PSNR" else [""] * 3
                    cells = [form.format(one[measure]) for one in scores.values()]
                    rows.append([*first, measure, *cells])
    print(table([["", "", "", "", *TITLES.values()], *rows]))
    text = f"{TITLES[DEFAULT[0]]}'s FLIP above the dataset's: "
    text += f"{np.mean(above):+.4f} on average, {max(above):+.4f} at most"
    print(bar(max(above) <= ALLOWED, f"{text} (at most {ALLOWED})"))
    contact_sheet(strips).save(own / "truth.png", optimize=True)


def rendered(scene: str, dataset: Dataset, shot: Shot, folder: Path) -> dict[str, Pixels]:
    """Cycles' pictures (y, x, 4) by the lights, made where they are not in the folder."""

    def path(lights: str) -> Path:
        return folder / f"{scene} {shot.object} {lights} {shot.size} {SAMPLES[scene]}.npy"

    missing = [lights for lights in LIGHTS if not path(lights).is_file()]
    if missing:
        with real_scene(build(scene), dataset, shot, SAMPLES[scene]) as stage:
            for lights in missing:
                remove_lights(stage)
                light_scene(stage, lights)
                np.save(path(lights), take(stage))
    return {lights: np.load(path(lights)) for lights in LIGHTS}


def kept(prefix: Path, quality: str, name: str) -> Path:
    """The file of pictures of the smooth mesh."""
    return prefix.with_name(f"{prefix.name} {name}{'' if name == 'dataset' else f' {quality}'}.npy")


def fitted(scene: str, dataset: Dataset, quality: str, folder: Path) -> dict[str, Path]:
    """Models by the methods at one quality, and so at about one size, made where missing."""
    files = {method: folder / f"{scene} {method} {quality}.exr" for method in METHODS}
    for method, file in files.items():
        if not file.is_file():
            settings = quality_settings(dataset, method, quality)
            model = compress_by_lightness(dataset, method, folder=folder, **settings)
            save_model(model, file)
    return files


def on_smooth_mesh(
    dataset: Dataset, models: dict[str, ClusteredTucker], view: View, kept: Callable[[str], Path]
) -> dict[str, dict[str, Pixels]]:
    """Pictures by the lights, and then of the dataset and of the models; kept(name) is the file of
    those of one, made where it is not there."""
    given = [lights(name) for name in LIGHTS]
    if not kept("dataset").is_file():
        np.save(kept("dataset"), of_dataset(dataset, view, given))
    for method, model in models.items():
        if not kept(method).is_file():
            np.save(kept(method), of_tables(build_tables(model), view, given))
    found = {name: np.load(kept(name)) for name in ("dataset", *models)}
    return {
        name: {of: pictures[number] for of, pictures in found.items()}
        for number, name in enumerate(LIGHTS)
    }


def in_engines(tables: Tables, dataset: Dataset) -> dict[str, float]:
    """How far a cloth under the sun in EEVEE and in Cycles, by nodes, is from the tables on the
    CPU, at the middle of each pixel: mean absolute difference relative to the mean."""
    shot = Shot("cloth", 4, SIZE // 2, CAMERA)
    view = look_at(dataset, shot, 1)
    (expected,) = of_tables(tables, view, [lights("sun")])
    material = material_from_tables(tables, "Truth")
    found = {}
    for engine in ENGINES:
        (angles, _), size = SUNS["sun"][0], (shot.size, shot.size)
        with object_scene(material, shot.object, size, engine, angles, CAMERA, 1) as scene:
            scene.render.filter_size = 0.0
            scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
            error = np.abs(render_pixels(scene) - expected)
        found[engine] = float(error[view.mask].mean() / expected[view.mask].mean())
    return found


def compared(
    truth: Pixels, seen: dict[str, Pixels], view: View
) -> tuple[dict[str, dict[str, Any]], list[Pixels]]:
    """Scores by what was seen, and the pictures in a row: Cycles', what was seen, FLIP's maps."""
    mask = view.mask
    reference = srgb(truth[..., :3] * mask[..., None])
    pictures = {name: srgb(picture * mask[..., None]) for name, picture in seen.items()}
    scores = {name: score(reference, one, mask[::-1]) for name, one in pictures.items()}
    return scores, [reference, *pictures.values(), *(one["map"] for one in scores.values())]


def contact_sheet(strips: list[tuple[str, list[Pixels]]]) -> Image.Image:
    """A row for each scene, object and light; columns named on top. In few colours, to be small."""
    titles = ["Cycles", *TITLES.values(), *(f"FLIP, {title}" for title in TITLES.values())]
    margin = 14
    sheet = Image.new("RGB", (TILE * len(titles), margin + len(strips) * (TILE + margin)))
    draw = ImageDraw.Draw(sheet)
    for column, title in enumerate(titles):
        draw.text((column * TILE + 2, 1), title, "white")
    for row, (name, pictures) in enumerate(strips):
        top = margin + row * (TILE + margin)
        draw.text((2, top + TILE), name, "white")
        for column, picture in enumerate(pictures):
            image = Image.fromarray(np.round(picture * 255).astype(np.uint8))
            sheet.paste(image.resize((TILE, TILE), Image.Resampling.BOX), (column * TILE, top))
    return sheet.quantize(256, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)


if __name__ == "__main__":
    main()
