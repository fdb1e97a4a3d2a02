"""One file, any quality: a sparse model made and looked at by its slider.

    blender --enable-event-simulate --python tests/gui/slider.py -- BTF FOLDER

The method SparseBTF with the dictionaries that Nacre comes with, the material, the slider moved,
dragged, undone and redone, in EEVEE and in the engine, and the file reopened. FOLDER takes pictures
of the window and `report.json`. The file named by the variable REAL_BLENDER_READY appears at the
end.
"""

import sys
import time
from collections.abc import Generator, Iterator
from itertools import pairwise
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from window import (
    FOLDER,
    MODEL,
    Wait,
    call,
    check,
    import_sample,
    job,
    make_material,
    picture,
    redo,
    report,
    settings,
    settle,
    show_rendered,
    shown,
    sphere_pixels,
    start,
    undo,
)

BLEND = FOLDER / "sample" / "slider.blend"
BEST = 64
STEPS = (1, 4, 16, BEST)


def story() -> Iterator[Wait]:
    yield from import_sample()
    yield from compress()
    yield from make_material("02-created")
    check("the best quality is shown", shown().nacre.quality == BEST)
    seen = yield from move_the_slider()
    yield from undo_the_slider(seen[BEST], seen[1])
    yield from drag_the_slider(seen[BEST], seen[1])
    yield from draw_with_nacre()
    yield from reopen()


# --- steps ----------------------------------------------------------------------------------------


def compress() -> Iterator[Wait]:
    settings().method = "SPARSE"
    yield 1.0
    picture("01-compress-panel")
    check("the panel names the dictionaries", "8 for Y" in settings().ensemble_facts)
    call(bpy.ops.nacre.compress)
    yield lambda: job() is None and settings().model_facts != ""
    check("the model is there", settings().model == str(MODEL))
    check("its quality is said", f"SparseBTF({BEST})" in settings().model_facts)


def move_the_slider() -> Generator[Wait, None, dict[int, np.ndarray]]:
    """The picture nears that of the best quality with every step; what each quality looks like."""
    best = sphere_pixels(picture("02-created"))
    seen = {}
    for quality in STEPS:
        begun = time.monotonic()
        slide(quality)
        yield from settle(f"03-quality-{quality}", 1.0, 0.4)
        report["seconds"][f"quality {quality}, still for a second"] = time.monotonic() - begun
        seen[quality] = sphere_pixels(picture(f"03-quality-{quality}"))
    errors = [float(np.abs(pixels - best).mean()) for pixels in seen.values()]
    report["differences from the best"] = errors
    check("every step is nearer to the best", all(b < a for a, b in pairwise(errors)))
    check("and the last one is it", errors[-1] < 0.1 * errors[0])
    return seen


def undo_the_slider(best: np.ndarray, least: np.ndarray) -> Iterator[Wait]:
    apart = np.abs(best - least).mean()
    slide(1)
    yield from settle("04-before-undo", 1.0, 0.4)
    for name, act, quality, wanted in (("undo", undo, BEST, best), ("redo", redo, 1, least)):
        act()
        yield from settle(f"04-{name}", 2.0, 0.5)
        check(f"{name} brings the slider back", shown().nacre.quality == quality)
        now = sphere_pixels(picture(f"04-{name}"))
        check(f"{name} brings the picture back", np.abs(now - wanted).mean() < 0.1 * apart)


def drag_the_slider(best: np.ndarray, least: np.ndarray) -> Iterator[Wait]:
    """As a hand does: many values, faster than tables are made."""
    for quality in range(1, BEST + 1):
        shown().nacre.quality = quality
        yield 0.03
    bpy.ops.ed.undo_push(message="Quality")
    yield from settle("05-dragged", 2.0, 0.5)
    now = sphere_pixels(picture("05-dragged"))
    check("the last value is shown", np.abs(now - best).mean() < 0.1 * np.abs(best - least).mean())


def draw_with_nacre() -> Iterator[Wait]:
    eevee = sphere_pixels(picture("06-eevee"))
    before = bpy.context.scene.render.engine
    bpy.context.scene.render.engine = "NACRE"
    yield from settle("06-nacre", 2.0, 0.7)
    nacre = sphere_pixels(picture("06-nacre"))
    check("the engine's picture is EEVEE's", np.abs(nacre - eevee).mean() < 0.02)
    slide(1)
    yield from settle("06-nacre-1", 2.0, 0.7)
    changed = np.abs(sphere_pixels(picture("06-nacre-1")) - nacre).mean()
    check("the engine follows the slider", changed > 0.001)
    bpy.context.scene.render.engine = before
    slide(BEST)
    yield from settle("06-eevee-again", 2.0, 0.7)


def reopen() -> Iterator[Wait]:
    slide(16)
    yield from settle("07-saved", 2.0, 0.5)
    before = sphere_pixels(picture("07-saved"))
    bpy.ops.wm.save_as_mainfile(filepath=str(BLEND))
    bpy.ops.wm.read_homefile(use_empty=True)
    yield 0.5
    bpy.ops.wm.open_mainfile(filepath=str(BLEND))
    show_rendered()
    yield from settle("07-reopened")
    check("the slider stands where it was", shown().nacre.quality == 16)
    after = sphere_pixels(picture("07-reopened"))
    check("the picture is as it was", np.abs(after - before).mean() < 0.005)


# --- what steps share -----------------------------------------------------------------------------


def slide(quality: int) -> None:
    shown().nacre.quality = quality
    bpy.ops.ed.undo_push(message="Quality")


start(story())
