"""The GLSL engine's frame time against that of its fetches alone, and how many it makes.

A plane fills the picture, square to an orthographic camera, under suns without shadows. The engine
is compared with a shader that makes the same fetches and only sums them. Tables have the shapes of
the papers' materials and random numbers. The same plane as a scene, beside EEVEE's frame of a
Principled BSDF with four image textures. `python -m benchmarks.glsl`
"""

from __future__ import annotations

import time
from statistics import median

import bpy
import gpu

from addon.preview.appearance import Appearance
from addon.preview.context import need_gpu
from addon.preview.draw import Resources, draw, prepare
from addon.preview.picture import camera_view
from addon.tables.sparse_layout import SparseLayout
from addon.tables.tables import Tables

from . import nodes
from ._glsl import Screen
from ._report import bar, table
from ._tables import random_tables

AT_MOST = 1.5
"""The engine's time over that of its fetches."""

SUNS = (1, 2, 4, 8)
SIZES = ((320, 240), (640, 480))
REPEATS = 9

# Shapes, then the RGBA fetches that their nonzeros need (once, for each light) and index fetches.
MATERIALS = {
    "K-CTA, Corduroy: R 20x4, C 8, K 3": (((1, 8), (1, 3), (20, 4)), (63, 15), (1, 0)),
    "MK-CTA, Hole: R 4x4, C 8x10, K 3x3": (((8, 10), (3, 3), (4, 4)), (0, 72), (1, 1)),
}


def main() -> None:
    need_gpu()
    for name, (shape, needed, index) in MATERIALS.items():
        tables = random_tables(*shape)
        print(name)
        fetches(tables, needed, index)
        frame_times(tables)
        against_principled(tables)


def fetches(tables: Tables, needed: tuple[int, int], index: tuple[int, int]) -> None:
    """Fetches counted by the shader itself, index fetches apart."""
    for suns in SUNS:
        screen = Screen(tables, (16, 16), suns)
        counted = int(screen.pixels(screen.counted()).max()) - index[0] - index[1] * suns
        most = needed[0] + needed[1] * suns
        print(bar(counted <= most, f"{suns} lights: {counted} RGBA fetches, {most} needed"))


def frame_times(tables: Tables) -> None:
    rows = [["Shortest frame, ms; median ratio", *(f"{suns} lights" for suns in SUNS)]]
    worst = 0.0
    for size in SIZES:
        mine, theirs, ratios = [], [], []
        for suns in SUNS:
            screen = Screen(tables, size, suns)
            engine, summed = screen.engine(), screen.summed()
            screen.seconds(engine), screen.seconds(summed)
            # In turn, so that what else the machine does slows both.
            times = [(screen.seconds(engine), screen.seconds(summed)) for _ in range(REPEATS)]
            first, second = (min(column) for column in zip(*times, strict=True))
            mine.append(f"{1e3 * first:.0f}")
            theirs.append(f"{1e3 * second:.0f}")
            ratio = median(one / other for one, other in times)
            ratios.append(f"{ratio:.2f}")
            worst = max(worst, ratio)
        label = "{}x{}".format(*size)
        rows += [
            [f"{label} engine", *mine],
            [f"{label} fetches summed", *theirs],
            [f"{label} ratio", *ratios],
        ]
    print(table(rows))
    print(bar(worst <= AT_MOST, f"the engine takes {worst:.2f} times its fetches at most"))


def against_principled(tables: Tables) -> None:
    """The engine's frame over EEVEE's; a viewport's, without what is around a final render."""
    rows = [["Frame over EEVEE's of a Principled BSDF", "1 light", f"{SUNS[-1]} lights"]]
    for size in nodes.SIZES:
        cells = []
        for suns in (1, SUNS[-1]):
            with nodes.lit_plane(size, suns) as (scene, _):
                theirs = nodes.frame(scene)
                cells.append(f"{engine_frame(scene, tables, size) / theirs:.2f}")
        rows.append(["{}x{}".format(*size), *cells])
    print(table(rows))


def engine_frame(
    scene: bpy.types.Scene, tables: Tables | SparseLayout, size: tuple[int, int]
) -> float:
    """Seconds in which the engine draws a prepared scene, to the last pixel."""
    layer = scene.view_layers[0]
    layer.update()
    resources = Resources()
    prepared = prepare(layer.depsgraph, resources, lambda _material: Appearance(btf=tables))
    view = camera_view(layer.depsgraph, size, (0.0, 0.0))
    screen = gpu.types.GPUOffScreen(*size, format="RGBA16F")
    taken = []
    with screen.bind():
        buffer = gpu.state.active_framebuffer_get()
        for _ in range(REPEATS):
            begun = time.perf_counter()
            buffer.clear(color=(0.0, 0.0, 0.0, 1.0), depth=1.0)
            draw(prepared, view, resources)
            buffer.read_color(0, 0, 1, 1, 4, 0, "FLOAT")
            taken.append(time.perf_counter() - begun)
    screen.free()
    return median(taken)


if __name__ == "__main__":
    main()
