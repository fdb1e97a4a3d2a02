"""Materials in the distance in EEVEE: levels of the core against the finest one alone.

    python -m benchmarks.distance [FOLDER] [--only NAMES]

A tilted plane is seen from where a pixel covers more and more texels, in two pictures between which
the camera comes 2 % nearer. The truth is the finest level with 8 x 8 pixels for each. "Error" is
the RMS difference from the truth over its mean, with one sample (a moving viewport) and with 16;
"flicker" that of the change from the first picture to the second, with one sample.

"Pixel" reads the level whose texels are about as large as the longer side of a pixel's footprint,
"half" and "quarter" those of half and a quarter as large. Then frames beside those of the finest
level alone. K-CTA models of medium quality. out/bench/distance_NAME.png: with one sample the finest
level, "pixel" and "half", and the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

import bpy
import numpy as np
from numpy.typing import NDArray

from addon.models.fit import compress, quality_settings
from addon.nodes import evaluation
from addon.nodes.graph import Graph, Wire
from addon.nodes.material import material_from_tables, set_lights
from addon.nodes.packed_tensor import Shapes
from addon.nodes.texel_group import Level
from addon.render.engines import render_pixels, set_engine
from addon.render.stage import add_camera, add_mesh, add_sun, new_scene
from addon.tables.tables import Tables, build_tables

from ._data import OUT, arguments, materials
from ._report import table
from .nodes import frame, seconds
from .recipes.sheet import write_png

PIXELS = 64
OVER = 8
FOOTPRINTS = (0.5, 3.0, 12.0)
"""Texels across a pixel where the plane is seen head-on."""
VIEW, LIGHT = (50.0, 270.0), (40.0, 30.0)
NEARER = 0.98

Chooser = Callable[[Graph, Wire, Shapes], Level]


def finest(g: Graph, _uv: Wire, _shapes: Shapes) -> Level:
    return Level(g, g.wire(g.node("ShaderNodeValue")))


CHOOSERS: dict[str, Chooser] = {
    "finest": finest,
    "pixel": partial(evaluation.choose_level, finer=0.0),
    "half": partial(evaluation.choose_level, finer=1.0),
    "quarter": partial(evaluation.choose_level, finer=2.0),
}


def main() -> None:
    options = arguments("distance", __doc__)
    for name, dataset in materials(options.folder, options.only).items():
        tables = build_tables(compress(dataset, "kcta", **quality_settings(dataset, "kcta")))
        heads = [f"{what}: {key}" for what in ("1 sample", "16", "flicker") for key in CHOOSERS]
        print(table([[name, *heads], *(row(tables, f, name) for f in FOOTPRINTS)]), flush=True)
        print(table([["frame", *CHOOSERS], *times(tables)]))


def row(tables: Tables, footprint: float, name: str) -> list[str]:
    truths = pair(tables, "finest", footprint, 1, OVER)
    cells: dict[str, list[str]] = {"one": [], "many": [], "flicker": []}
    shown = []
    for key in CHOOSERS:
        seen = pair(tables, key, footprint, 1)
        shown.append(seen[0])
        cells["one"].append(difference(seen[0], truths[0], truths[0]))
        cells["flicker"].append(difference(seen[1] - seen[0], truths[1] - truths[0], truths[0]))
        many = pair(tables, key, footprint, 16, count=1)
        cells["many"].append(difference(many[0], truths[0], truths[0]))
    if footprint == 3.0:
        write_png(np.concatenate([*shown[:3], truths[0]], 1), OUT / f"distance_{name}.png")
    return [f"{footprint:g} texels a pixel", *(cell for part in cells.values() for cell in part)]


def difference(seen: NDArray, wanted: NDArray, truth: NDArray) -> str:
    return f"{100 * np.sqrt(np.mean((seen - wanted) ** 2)) / truth.mean():.1f} %"


def pair(
    tables: Tables, chooser: str, footprint: float, samples: int, over: int = 1, count: int = 2
) -> list[NDArray[np.float32]]:
    with far_plane(tables, chooser, footprint, over) as scene:
        set_engine(scene, "eevee", samples)
        pictures = []
        for _ in range(count):
            big = render_pixels(scene)
            pictures.append(big.reshape(PIXELS, over, PIXELS, over, 3).mean((1, 3)))
            scene.camera.data.ortho_scale *= NEARER
    return pictures


@contextmanager
def far_plane(
    tables: Tables, chooser: str, footprint: float, over: int = 1
) -> Iterator[bpy.types.Scene]:
    """A plane that fills the picture, of which a pixel covers `footprint` texels along x."""
    kept, evaluation.choose_level = evaluation.choose_level, CHOOSERS[chooser]
    try:
        with new_scene((over * PIXELS, over * PIXELS)) as scene:
            material = material_from_tables(tables, "Model")
            plane = add_mesh(scene, "plane", material)
            camera = add_camera(scene, VIEW, 0.5)
            repeat = footprint * PIXELS / (0.5 * tables.core.shape[5])
            for corner in plane.data.uv_layers.active.uv:
                corner.vector = [repeat * value for value in corner.vector]
            camera.location.x += 0.001
            add_sun(scene, LIGHT).data.use_shadow = False
            scene.render.filter_size = 0.0 if over > 1 else 1.0
            set_lights(material, scene)
            yield scene
    finally:
        evaluation.choose_level = kept


def times(tables: Tables) -> list[list[str]]:
    rows = []
    for footprint in (0.5, 3.0):
        found = []
        for key in CHOOSERS:
            with far_plane(tables, key, footprint, 2) as scene:
                seconds(scene, 1)
                found.append(f"{1e3 * frame(scene):.0f} ms")
        rows.append([f"{footprint:g} texels a pixel", *found])
    return rows


if __name__ == "__main__":
    main()
