"""The render engine "Nacre": the viewport and F12."""

from __future__ import annotations

from contextlib import suppress
from functools import partial

import bpy
import gpu

from ..errors import NacreError
from .appearance import appearance_of, final_appearance_of
from .copy_picture import copy_picture, copy_shader
from .draw import Prepared, Resources, draw, prepare, table_bytes
from .picture import background, camera_picture
from .readings import Readings
from .view import View

INTERVAL = 0.2
"""Seconds between two looks at models that are being read."""


class NACRE_RE_engine(bpy.types.RenderEngine):
    """Measured materials from texture arrays, with everything the papers do, at full speed."""

    bl_idname = "NACRE"
    bl_label = "Nacre"
    bl_use_preview = False
    # Rendering happens on another thread, which needs a context of its own. 4.5 has none in
    # background, and would wait for it for ever.
    bl_use_gpu_context = bpy.app.version >= (5, 0, 0) or not bpy.app.background

    def render(self, depsgraph: bpy.types.Depsgraph) -> None:
        """F12: the camera's picture."""
        render = depsgraph.scene.render
        scale = render.resolution_percentage / 100.0
        size = max(1, int(render.resolution_x * scale)), max(1, int(render.resolution_y * scale))
        try:
            pixels, messages = camera_picture(depsgraph, size, appearance=final_appearance_of)
        except NacreError as error:
            self.report({"ERROR"}, str(error))
            self.error_set(str(error))
            return
        for message in messages:
            self.report({"WARNING"}, message)
        result = self.begin_result(0, 0, *size)
        result.layers[0].passes["Combined"].rect.foreach_set(pixels.ravel())
        self.end_result(result)

    def view_update(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """The scene changed: it is read again when it is drawn next, not while the view turns."""
        resources = self._resources()
        self.prepared = None
        for update in depsgraph.updates:
            if isinstance(update.id, bpy.types.Object) and update.is_updated_geometry:
                changed = update.id.original.session_uid
                for key in [key for key in resources.meshes if key[0] == changed]:
                    del resources.meshes[key]
        self.tag_redraw()

    def view_draw(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Draw the viewport."""
        region, space = context.region, context.region_data
        view = View.of(space.view_matrix, space.window_matrix)
        resources = self._resources()
        # Making an off-screen buffer leaves the viewport's unbound.
        viewport = gpu.state.active_framebuffer_get()
        screen = gpu.types.GPUOffScreen(region.width, region.height, format="RGBA16F")
        try:
            prepared = self.prepared or prepare(
                depsgraph, resources, partial(appearance_of, read=self.readings.tables_of)
            )
            self.prepared = prepared
            self._draw_again_once_read()
            with screen.bind():
                gpu.state.active_framebuffer_get().clear(
                    color=background(depsgraph.scene), depth=1.0
                )
                draw(prepared, view, resources)
            self.update_stats("Nacre", "; ".join((status(prepared, resources), *prepared.messages)))
            with viewport.bind():
                copy_picture(screen.texture_color, resources.shader("copy", copy_shader))
        except NacreError as error:
            self.update_stats("Nacre", str(error))
        finally:
            screen.free()

    def _resources(self) -> Resources:
        # __init__ is not called in 4.5 the way Python's is.
        if not hasattr(self, "kept"):
            self.kept, self.prepared = Resources(), None
            self.readings, self.waiting = Readings(), False
        return self.kept

    def _draw_again_once_read(self) -> None:
        """Show the models that threads are still reading when they are there."""
        running = self.readings.running()
        if not running or self.waiting:
            return
        self.waiting = True

        def look() -> float | None:
            if any(not future.done() for future in running):
                return INTERVAL
            with suppress(ReferenceError):  # the viewport shows something else by now
                self.waiting, self.prepared = False, None
                self.tag_redraw()
            return None

        bpy.app.timers.register(look, first_interval=INTERVAL)


def status(scene: Prepared, resources: Resources) -> str:
    """What the picture took, for the viewport's corner."""
    return f"{scene.count} lights, {table_bytes(resources) / 1e6:.1f} MB of tables on the GPU"
