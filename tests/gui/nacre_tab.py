"""The Nacre tab in a real Blender window, used as an artist uses it. README.md says how to run it.

    blender --enable-event-simulate --python tests/gui/nacre_tab.py -- BTF FOLDER

Imports the file BTF, compresses it and makes the material through the real operators, with undo,
redo and cancelling on the way, and ends with the tab open beside the material in the rendered
viewport. FOLDER takes the dataset, the model, pictures of the window and `report.json`. The file
named by the variable REAL_BLENDER_READY appears at the end.
"""

import os
import shutil
import sys
import time
from collections.abc import Iterator
from functools import partial
from math import radians
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from window import (
    BTF,
    DATASET,
    FOLDER,
    MODEL,
    MODULE,
    SOURCE,
    Wait,
    call,
    check,
    drop,
    job,
    leftovers,
    picture,
    press,
    redo,
    report,
    set_up,
    settings,
    settle,
    sidebar,
    sphere_pixels,
    start,
    undo,
    viewport,
    window,
)


def story() -> Iterator[Wait]:
    """What the user does; each yield waits for seconds, or until something is true."""
    yield from end_early()
    yield from set_up()
    yield from measure()
    yield from refuse_a_damaged_file()
    yield from cancel_an_import()
    yield from import_by_file_browser()
    yield from compress()
    yield from create_material()
    yield from look()


def end_early() -> Iterator[Wait]:
    """The extension is disabled, or another file is opened, in the middle of an import."""
    if SOURCE.parent.exists():
        shutil.rmtree(SOURCE.parent)
    SOURCE.parent.mkdir(parents=True)
    shutil.copy(BTF, SOURCE)
    press("ESC")  # the splash screen
    yield 0.5
    for what, action in (
        ("disabling the extension", partial(bpy.ops.preferences.addon_disable, module=MODULE)),
        ("opening another file", bpy.ops.wm.read_homefile),
    ):
        bpy.ops.preferences.addon_enable(module=MODULE)
        preferences = bpy.context.preferences
        preferences.view.show_splash = False
        preferences.view.filebrowser_display_type = "SCREEN"  # no second window
        jobs = sys.modules[MODULE + ".jobs"]
        yield from drop(SOURCE)
        yield lambda: job() is not None and leftovers() != []
        action()
        check(f"{what} ends the job", jobs.running() is None)
        check(f"{what} leaves nothing of the import", leftovers() == [])
        yield 1.0


def measure() -> Iterator[Wait]:
    """A plane measured by a second Blender: stopped, gone on with, undone."""
    from bl_ext.user_default.nacre.measure.unfinished import count_finished

    output = FOLDER / "sample" / "plane.nacre"
    before = everything()
    chosen = settings().measurement
    chosen.object, chosen.output = bpy.data.objects["Sphere"], str(output)
    chosen.texels, chosen.samples = 32, 64
    chosen.views = chosen.lights = "uniform"
    chosen.view_count, chosen.light_count = 16, 8
    bpy.ops.ed.undo_push(message="Measurement")
    open_measure_panel()
    yield 1.0
    picture("10-measure")
    started = time.monotonic()
    call(bpy.ops.nacre.measure)
    yield lambda: count_finished(output) > 0 or job() is None
    yield 0.3
    picture("11-measuring")
    check("the measurement runs on a thread", job() is not None)
    call(bpy.ops.nacre.cancel)
    yield lambda: job() is None
    yield 0.5
    kept = count_finished(output)
    check("cancelling keeps the finished pictures", 0 < kept < 8 and not output.exists())
    check("cancelling leaves the scene as it was", everything() == before)
    picture("12-unfinished")
    call(bpy.ops.nacre.measure)
    yield lambda: settings().dataset != "" or job() is None
    report["seconds"]["measure"] = round(time.monotonic() - started, 1)
    yield 0.3
    check("the measurement becomes the dataset", settings().dataset == str(output))
    check("the panel knows the measurement", "8 lights" in settings().dataset_facts)
    check("nothing unfinished is left", leftovers() == [output.name])
    check("measuring leaves the scene as it was", everything() == before)
    open_measure_panel()  # which closes it again
    yield 0.5
    undo()
    yield 0.3
    check("undo takes the measurement back", settings().dataset == "")
    shutil.rmtree(output)


def open_measure_panel() -> None:
    """A click on the title of the Measure panel, below the Import panel; no script can open one."""
    region = sidebar()
    below = round(107 * bpy.context.preferences.system.ui_scale)
    press("LEFTMOUSE", region.x + 60, region.y + region.height - below)


def everything() -> list[str]:
    """The names of all that the file holds."""
    kinds = ("scenes", "objects", "meshes", "lights", "cameras", "worlds", "collections")
    return sorted(f"{kind}/{item.name}" for kind in kinds for item in getattr(bpy.data, kind))


def refuse_a_damaged_file() -> Iterator[Wait]:
    damaged = FOLDER / "damaged.btf"
    damaged.write_bytes(SOURCE.read_bytes()[:100_000])
    yield from drop(damaged)
    yield 1.0
    picture("3-damaged")
    check("a damaged file leaves nothing", not damaged.with_suffix(".nacre").exists())
    check("a damaged file leaves the dataset unset", settings().dataset == "")
    press("ESC")  # the report
    yield 0.5


def cancel_an_import() -> Iterator[Wait]:
    """Stopped with Esc."""
    yield from drop(SOURCE)
    yield lambda: job() is not None
    yield lambda: job() is None or job().fraction > 0.1
    check("the import runs on a thread", job() is not None)
    picture("4-importing")
    check("it writes beside the file", leftovers() != [])
    press("ESC")
    yield lambda: job() is None
    yield 0.5
    check("Esc leaves nothing of the import", leftovers() == [])
    check("Esc leaves the dataset unset", settings().dataset == "")


def import_by_file_browser() -> Iterator[Wait]:
    call(bpy.ops.nacre.import_btf)
    yield lambda: any(area.type == "FILE_BROWSER" for area in window().screen.areas)
    area = next(area for area in window().screen.areas if area.type == "FILE_BROWSER")
    space = area.spaces.active
    yield lambda: space.params is not None
    space.params.directory = os.fsencode(SOURCE.parent)
    yield 1.5
    region = next(region for region in area.regions if region.type == "WINDOW")
    row = round(38 * bpy.context.preferences.system.ui_scale)  # the first file, below the titles
    press("LEFTMOUSE", region.x + 60, region.y + region.height - row)
    yield 1.5
    picture("5-file-browser")
    check("a click chooses the file", space.params.filename == SOURCE.name)
    started = time.monotonic()
    with bpy.context.temp_override(window=window(), area=area, region=region):
        bpy.ops.file.execute("INVOKE_DEFAULT")
    yield lambda: settings().dataset != ""
    report["seconds"]["import"] = round(time.monotonic() - started, 1)
    yield 0.3
    check("the dataset is beside the file", leftovers() == [DATASET.name])
    check("the panel knows the dataset", "81 lights" in settings().dataset_facts)
    undo()
    yield 0.3
    check("undo takes the dataset back", settings().dataset == settings().dataset_facts == "")
    redo()
    yield 0.3
    check("redo brings the dataset", settings().dataset == str(DATASET))


def compress() -> Iterator[Wait]:
    settings().quality = "HIGH"
    call(bpy.ops.nacre.compress)
    yield lambda: job() is None or job().fraction > 0.3
    yield 0.3
    picture("6-compressing")
    check("the compression runs on a thread", job() is not None)
    call(bpy.ops.nacre.cancel)
    yield lambda: job() is None
    yield 0.5
    check("cancelling leaves no model", leftovers() == [DATASET.name])
    check("cancelling leaves the model unset", settings().model == "")

    settings().quality = "MEDIUM"
    bpy.ops.ed.undo_push(message="Quality")
    started = time.monotonic()
    call(bpy.ops.nacre.compress)
    yield lambda: settings().model != ""
    report["seconds"]["compress"] = round(time.monotonic() - started, 1)
    yield 0.3
    check("the model is beside the dataset", leftovers() == [MODEL.name, DATASET.name])
    check("the panel knows the model", "dB" in settings().model_facts)
    report["model"] = settings().model_facts
    undo()
    yield 0.3
    check("undo takes the model back", settings().model == settings().model_facts == "")
    check("undo takes back no more", settings().dataset == str(DATASET))
    redo()
    yield 0.3
    check("redo brings the model", settings().model == str(MODEL))


def create_material() -> Iterator[Wait]:
    def material() -> bpy.types.Material | None:
        return bpy.data.objects["Sphere"].active_material

    started = time.monotonic()
    call(bpy.ops.nacre.create_material)
    yield 0.4
    picture("7-creating")
    yield lambda: material() is not None
    report["seconds"]["create material"] = round(time.monotonic() - started, 1)
    yield 0.3
    check("the material is named after the model", material().name == MODEL.stem)
    check("it follows the scene's lights", "Nacre Lights Scene" in bpy.data.node_groups)
    undo()
    yield 0.3
    check("undo takes the material back", material() is None)
    check("undo leaves no images", all(image.source == "VIEWER" for image in bpy.data.images))
    redo()
    yield 0.3
    check("redo brings the material", material() is not None)
    repeat = material().node_tree.nodes["Repeat"].inputs[1]
    repeat.default_value = (6, 3, 1)


def look() -> Iterator[Wait]:
    """EEVEE's picture of it, once it no longer changes; then another light."""
    space = viewport()["area"].spaces.active
    space.shading.type = "RENDERED"
    started = time.monotonic()
    yield from settle("8-lit")
    report["seconds"]["first picture"] = round(time.monotonic() - started, 1)
    before = sphere_pixels(picture("8-lit"))
    check("the sphere is lit and has detail", before.mean() > 0.02 and before.std() > 0.01)
    # Without its image, or with too many of them, EEVEE shows a material in magenta.
    magenta = (before[..., 0] > 0.9) & (before[..., 1] < 0.1) & (before[..., 2] > 0.9)
    check("nothing is magenta", not magenta.any())
    bpy.data.objects["Sun"].rotation_euler = (radians(35), radians(25), 0)
    yield from settle("9-another-light")
    after = sphere_pixels(picture("9-another-light"))
    check("the picture follows the sun", np.abs(after - before).mean() > 0.01)


start(story())
