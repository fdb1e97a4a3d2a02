"""The scene as EEVEE and as Cycles render it, side by side in the image editor.

In the window a second Blender renders a copy of the file: this one stays usable, and untouched
whatever happens. Without a window the scene is rendered where it was called.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy

from ..errors import Cancelled, NacreError
from ..jobs import JobOperator, Progress, Work
from ..models.exr import read_picture
from ..render.comparison import ENGINES, Pixels, differences, scene_pixels, show
from ..second_blender import follow, nacre_command, save_copy
from .ready import is_ready

LABELS = {"eevee": "EEVEE", "cycles": "Cycles"}


class NACRE_OT_compare_with_cycles(JobOperator, bpy.types.Operator):
    """Render the scene with EEVEE and with Cycles, and show both and their difference"""

    bl_idname = "nacre.compare_with_cycles"
    bl_label = "Compare with Cycles"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.scene.camera is None:
            cls.poll_message_set("Add a camera: what it sees is compared")
            return False
        return is_ready(cls)

    def prepare(self, context: bpy.types.Context) -> Work:
        if bpy.app.background:
            scene = context.scene
            return lambda progress: {engine: scene_pixels(scene, engine) for engine in ENGINES}
        folder = tempfile.TemporaryDirectory()
        file = save_copy(folder.name)

        def work(progress: Progress) -> dict[str, Pixels]:
            with folder:
                return {engine: _render_there(file, engine, progress) for engine in ENGINES}

        return work

    def finish(self, context: bpy.types.Context, result: dict[str, Pixels]) -> None:
        first, second = (result[engine] for engine in ENGINES)
        if first.shape != second.shape:
            raise NacreError("the two pictures differ in size: does a handler change the scene?")
        found = differences(first, second)
        chosen = context.scene.nacre.comparison
        chosen.facts = (
            f"PSNR\t{found['psnr_db']:.1f} dB\n"
            f"Mean error\t{found['mean_abs']:.4f} ({found['relative']:.1%})"
        )
        image = show(result, chosen.wipe)
        if not bpy.app.background:
            _open_image(context, image)
        self.report({"INFO"}, f"EEVEE against Cycles: PSNR {found['psnr_db']:.1f} dB")


def _render_there(file: Path, engine: str, progress: Progress) -> Pixels:
    """A picture by another Blender."""
    done = ENGINES.index(engine) / len(ENGINES)

    def look() -> None:
        if not progress(done, f"Rendering with {LABELS[engine]}"):
            raise Cancelled

    picture = file.with_name(f"{engine}.exr")
    follow(nacre_command("render", str(file), str(picture), "--engine", engine), look)
    return read_picture(picture)


def _open_image(context: bpy.types.Context, image: bpy.types.Image) -> None:
    """Show an image in the first image editor, in a new window when there is none."""
    areas = [area for window in context.window_manager.windows for area in window.screen.areas]
    area = next((area for area in areas if area.type == "IMAGE_EDITOR"), None)
    if area is None:
        bpy.ops.wm.window_new()
        area = context.window_manager.windows[-1].screen.areas[0]
        area.ui_type = "IMAGE_EDITOR"
    area.spaces.active.image = image
    area.tag_redraw()
