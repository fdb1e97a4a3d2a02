"""The Nacre tab in a real Blender window, used as an artist uses it. README.md says how to run it.

    blender --enable-event-simulate --python tests/gui/nacre_tab.py -- BTF FOLDER

Imports the file BTF, compresses it and makes the material through the real operators, with undo,
redo and cancelling on the way, and ends with the tab open beside the material in the rendered
viewport. FOLDER takes the dataset, the model, pictures of the window and `report.json`.
"""

import json
import os
import shutil
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from functools import partial
from math import pi, radians
from pathlib import Path

import bpy
import numpy as np

BTF, FOLDER = (Path(argument).resolve() for argument in sys.argv[sys.argv.index("--") + 1 :][:2])
SOURCE = FOLDER / "sample" / "wool.btf"
DATASET, MODEL = SOURCE.with_suffix(".nacre"), SOURCE.with_suffix(".exr")
MODULE = "bl_ext.user_default.nacre"
LIMIT = 240.0
# Blender cannot picture its own window on every driver.
SCREENSHOT = os.environ.get("NACRE_SCREENSHOT", "fb-png").split()

report: dict = {"passed": False, "checks": [], "seconds": {}}
Wait = float | Callable[[], bool]


def check(name: str, fulfilled: bool) -> None:
    """Note one check; the report lists all of them."""
    report["checks"].append({"check": name, "passed": bool(fulfilled)})
    print("ok  " if fulfilled else "FAIL", name, flush=True)


# --- the window -----------------------------------------------------------------------------------


def window() -> bpy.types.Window:
    return bpy.context.window_manager.windows[0]


def viewport() -> dict:
    """What an operator called from a button of the 3D viewport finds in its context."""
    areas = [area for area in window().screen.areas if area.type == "VIEW_3D"]
    area = max(areas, key=lambda area: area.width * area.height)
    region = next(region for region in area.regions if region.type == "WINDOW")
    return {"window": window(), "area": area, "region": region}


def call(operator: Callable, **options) -> None:
    """Run an operator as a button does: from the viewport, in the window, with undo."""
    with bpy.context.temp_override(**viewport()):
        operator("INVOKE_DEFAULT", True, **options)


def press(key: str, x: int = 400, y: int = 400) -> None:
    """A key or mouse button pressed at a place of the window, by default over the viewport."""
    window().event_simulate("MOUSEMOVE", "NOTHING", x=x, y=y)
    window().event_simulate(key, "PRESS", x=x, y=y)
    window().event_simulate(key, "RELEASE", x=x, y=y)


def picture(name: str) -> np.ndarray:
    """A picture of the screen: FOLDER/name.png, and its pixels (height, width, 3), bottom first."""
    from PIL import Image  # one of the extension's own wheels

    path = FOLDER / f"{name}.png"
    subprocess.run([*SCREENSHOT, str(path)], check=True)
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), np.float32)[::-1] / 255.0


def sphere_pixels(pixels: np.ndarray) -> np.ndarray:
    """The middle of the viewport, which the sphere fills."""
    region = viewport()["region"]
    side = min(region.width, region.height) // 8
    x, y = region.x + region.width // 2, region.y + region.height // 2
    return pixels[y - side : y + side, x - side : x + side]


def undo() -> None:
    call(bpy.ops.ed.undo)


def redo() -> None:
    call(bpy.ops.ed.redo)


def settings() -> bpy.types.PropertyGroup:
    return bpy.context.scene.nacre


def job():
    """The extension's job under way, or None."""
    return sys.modules[MODULE + ".jobs"].running()


def leftovers() -> list[str]:
    """What lies beside the measured file."""
    return sorted(path.name for path in SOURCE.parent.iterdir() if path != SOURCE)


# --- the story ------------------------------------------------------------------------------------


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


def drop(path: Path) -> Iterator[Wait]:
    """A file dropped on the viewport, confirmed with Return."""
    call(bpy.ops.nacre.import_btf, filepath=str(path))
    yield 1.0
    picture("2-dropped")
    press("RET")


def set_up() -> Iterator[Wait]:
    """A sphere under a sun in an otherwise empty file, the tab open."""
    for item in list(bpy.data.objects):
        bpy.data.objects.remove(item)
    with bpy.context.temp_override(**viewport()):
        bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48)
        bpy.ops.object.shade_smooth()
        bpy.ops.object.light_add(type="SUN", rotation=(radians(60), 0, radians(-20)))
    bpy.context.object.data.energy = pi
    sphere = bpy.data.objects["Sphere"]
    bpy.context.object.select_set(False)
    sphere.select_set(True)
    bpy.context.view_layer.objects.active = sphere
    space = viewport()["area"].spaces.active
    space.overlay.show_overlays = space.show_gizmo = False
    space.region_3d.view_distance = 4.0
    space.show_region_ui = True
    yield 0.5
    sidebar().active_panel_category = "Nacre"
    bpy.ops.ed.undo_push(message="Set Up")
    yield 1.0
    check("the tab is open", sidebar().active_panel_category == "Nacre")
    picture("1-empty")


def sidebar() -> bpy.types.Region:
    return next(region for region in viewport()["area"].regions if region.type == "UI")


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


def settle(name: str) -> Iterator[Wait]:
    """Wait until the sphere is not grey as before its shader is compiled, and stands still."""
    last, still = None, 0
    begun = time.monotonic()
    while still < 3 and time.monotonic() - begun < LIMIT:
        yield 1.5
        now = sphere_pixels(picture(name))
        same = last is not None and np.abs(now - last).max() < 0.02
        still = still + 1 if same and time.monotonic() - begun > 6.0 else 0
        last = now


# --- the clock ------------------------------------------------------------------------------------


def finish(error: str = "") -> None:
    checks = report["checks"]
    report["passed"] = not error and all(entry["passed"] for entry in checks)
    if error:
        report["error"] = error
    report["blender"] = bpy.app.version_string
    (FOLDER / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    print("PASSED" if report["passed"] else "FAILED", f"({len(checks)} checks)", flush=True)
    ready = os.environ.get("REAL_BLENDER_READY")
    if ready:
        Path(ready).touch()


def run() -> Callable[[], float | None]:
    """A timer's function that goes through the story."""
    progress = story()
    waiting: list = [0.0, 0.0]  # for what, since when

    def tick() -> float | None:
        wait, since = waiting
        passed = time.monotonic() - since
        if callable(wait) and passed > LIMIT:
            finish(f"waited {LIMIT:.0f} s in vain: {progress.gi_yieldfrom}")
            return None
        try:
            if passed < wait if isinstance(wait, float) else not wait():
                return 0.05
            waiting[:] = next(progress), time.monotonic()
        except StopIteration:
            finish()
            return None
        except Exception:
            traceback.print_exc()
            finish(traceback.format_exc())
            return None
        return 0.05

    return tick


FOLDER.mkdir(parents=True, exist_ok=True)
bpy.app.timers.register(run(), first_interval=1.0, persistent=True)
