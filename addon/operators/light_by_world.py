"""The world's light on materials that show a model."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import BoolProperty

from ..errors import NacreError
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
        from ..nodes.kept_world import KeptWorld, environment_for
        from ..nodes.material import groups_of
        from ..nodes.packed_tables import stored, unpack
        from ..render.world_light import read_world
        from ..tables.sparse_tables import SparseTables

        self._material = context.object.active_material
        if self.remove:
            return lambda progress: ([], None)
        models = [unpack(stored(group)) for group in groups_of(self._material)]
        if isinstance(models[0], SparseTables):
            raise NacreError(
                f"{self._material.name}: a sparse model is not lit by worlds, for its values are "
                "logarithms, which do not add up; light it by lamps, or show a model of another "
                "method"
            )
        world = context.scene.world
        light = read_world(world)
        kept = KeptWorld(
            light.radiance, world.name if world else "", light.mapping.name if light.mapping else ""
        )

        def work(progress: Progress) -> Any:
            found = []
            for number, tables in enumerate(models):
                progress(number / len(models), "Convolving the light basis with the world")
                found.append(environment_for(kept, tables))
            return found, kept

        return work

    def finish(self, context: bpy.types.Context, result: Any) -> None:
        from ..nodes.material import set_environment

        environments, kept = result
        set_environment(self._material, environments, kept)
        if kept is not None:
            self.report({"INFO"}, f"{self._material.name} is lit by the world {kept.world}")
