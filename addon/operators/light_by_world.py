"""The world's light on materials that show a model."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import BoolProperty

from ..jobs import JobOperator, Progress, Work
from .ready import has_model, is_ready


class NACRE_OT_light_by_world(JobOperator, bpy.types.Operator):
    """Read the scene's world again, and light the active material by it, too"""

    bl_idname = "nacre.light_by_world"
    bl_label = "World Light"
    bl_options = {"UNDO"}

    remove: BoolProperty(
        name="Remove",
        description="Take the world's light away again",
        default=False,
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return has_model(cls, context) and is_ready(cls)

    def prepare(self, context: bpy.types.Context) -> Work:
        from ..nodes.material import groups_of
        from ..nodes.packed_tables import stored, unpack
        from ..render.world_light import read_world
        from ..tables.environment import build_environment
        from ..tables.light_lobes import light_lobes

        self._material = context.object.active_material
        groups = groups_of(self._material)
        if self.remove:
            return lambda progress: [None] * len(groups)
        self._light = read_world(context.scene.world)
        self._world = context.scene.world.name if context.scene.world else ""
        lights = [unpack(stored(group)) for group in groups]

        def work(progress: Progress) -> Any:
            found = []
            for number, tables in enumerate(lights):
                progress(number / len(lights), "Convolving the light basis with the world")
                found.append(build_environment(light_lobes(tables), self._light.radiance))
            return found

        return work

    def finish(self, context: bpy.types.Context, result: Any) -> None:
        from ..nodes.material import set_environment

        if self.remove:
            set_environment(self._material, result)
            return
        turning = self._light.mapping
        set_environment(
            self._material, result, self._world, turning.name if turning is not None else ""
        )
        self.report({"INFO"}, f"{self._material.name} is lit by the world {self._world}")
