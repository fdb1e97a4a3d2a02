"""What the scripts of this folder share: the window, the user's hands, checks and the clock.

A script is a generator of waits: seconds, or something to become true. See README.md.
"""

import json
import os
import shutil
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from math import pi, radians
from pathlib import Path

import bpy
import numpy as np

BTF, FOLDER = (Path(argument).resolve() for argument in sys.argv[sys.argv.index("--") + 1 :][:2])
SOURCE = FOLDER / "sample" / "wool.btf"
DATASET, MODEL = SOURCE.with_suffix(".nacre"), SOURCE.with_suffix(".exr")
MODULE = "bl_ext.user_default.nacre"
LIMIT = 240.0
SAME, CHANGED = 0.008, 0.02  # mean differences of the sphere's picture
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


def sidebar() -> bpy.types.Region:
    return next(region for region in viewport()["area"].regions if region.type == "UI")


# --- what every story begins with -----------------------------------------------------------------


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


def import_sample() -> Iterator[Wait]:
    """The measured file alone in its folder, imported over a sphere under a sun."""
    if SOURCE.parent.exists():
        shutil.rmtree(SOURCE.parent)
    SOURCE.parent.mkdir(parents=True)
    shutil.copy(BTF, SOURCE)
    bpy.context.preferences.view.show_splash = False
    press("ESC")  # the splash screen
    yield 0.5
    yield from set_up()
    call(bpy.ops.nacre.import_btf, filepath=str(SOURCE))
    yield 1.0
    press("RET")
    yield lambda: settings().dataset != ""


def settle(name: str, least: float = 6.0, every: float = 1.5) -> Iterator[Wait]:
    """Wait until the sphere is not grey as before its shader is compiled, and stands still."""
    last, still = None, 0
    begun = time.monotonic()
    while still < 3 and time.monotonic() - begun < LIMIT:
        yield every
        now = sphere_pixels(picture(name))
        same = last is not None and np.abs(now - last).max() < 0.02
        still = still + 1 if same and time.monotonic() - begun > least else 0
        last = now


# --- what steps share -----------------------------------------------------------------------------


def step(
    name: str, action: Callable[[], None], steps: int = 1, least: float = CHANGED
) -> Iterator[Wait]:
    """Something that changes the picture by `least`; undone and redone."""
    before = sphere_pixels(picture(name))
    action()
    yield 0.2
    yield lambda: job() is None
    begun = time.monotonic()
    yield (
        lambda: (
            np.abs(sphere_pixels(picture(name)) - before).mean() > least
            or time.monotonic() - begun > 20.0
        )
    )
    yield from settle(name, 1.5, 0.6)
    after = sphere_pixels(picture(name))
    check(f"{name[3:]}: the picture follows", np.abs(after - before).mean() > least)
    check(f"{name[3:]}: nothing is magenta", not magenta(after))
    for what, act, expected in (("undo", undo, before), ("redo", redo, after)):
        for _ in range(steps):
            act()
            yield 0.2
        # EEVEE shows the last picture until it has compiled.
        begun = time.monotonic()
        yield (
            lambda since=begun, wanted=expected, of=f"{name}-{what}": (
                np.abs(sphere_pixels(picture(of)) - wanted).mean() < SAME
                or time.monotonic() - since > 20.0
            )
        )
        yield from settle(f"{name}-{what}", 2.0, 0.6)
        difference = np.abs(sphere_pixels(picture(f"{name}-{what}")) - expected).mean()
        if difference >= SAME:
            report.setdefault("differences", {})[f"{name} {what}"] = float(difference)
        check(f"{name[3:]}: {what} shows it as it was", difference < SAME)


def make_material(name: str) -> Iterator[Wait]:
    """The model on the sphere, in rendered shading."""
    call(bpy.ops.nacre.create_material)
    yield lambda: shown() is not None
    shown().node_tree.nodes["Repeat"].inputs[1].default_value = (6, 3, 1)
    bpy.ops.ed.undo_push(message="Repeat")
    show_rendered()
    yield from settle(name)
    pixels = sphere_pixels(picture(name))
    check("the sphere is lit and has detail", pixels.mean() > 0.02 and pixels.std() > 0.01)
    check("nothing is magenta", not magenta(pixels))


def show_rendered() -> None:
    """Blender opens files in solid shading, whatever they were saved in."""
    viewport()["area"].spaces.active.shading.type = "RENDERED"


def select_sphere() -> None:
    for item in bpy.context.view_layer.objects:
        item.select_set(item.name == "Sphere")
    bpy.context.view_layer.objects.active = bpy.data.objects["Sphere"]


def shown() -> bpy.types.Material | None:
    return bpy.data.objects["Sphere"].active_material


def magenta(pixels: np.ndarray) -> bool:
    """How EEVEE shows a material without its image, or with too many of them."""
    return bool(((pixels[..., 0] > 0.9) & (pixels[..., 1] < 0.1) & (pixels[..., 2] > 0.9)).any())


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


def clock(progress: Iterator[Wait]) -> Callable[[], float | None]:
    """A timer's function that goes through a story."""
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


def start(story: Iterator[Wait]) -> None:
    """Go through a story from now on, whatever files are loaded meanwhile."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    bpy.app.timers.register(clock(story), first_interval=1.0, persistent=True)
