"""A material laid anew so that it does not show where its patch repeats."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import BoolProperty

from ..jobs import JobOperator, Progress, Work
from .ready import has_model, is_ready


class NACRE_OT_hide_repetition(JobOperator, bpy.types.Operator):
    """Lay the active material's patch anew, so that it does not show where it repeats"""

    bl_idname = "nacre.hide_repetition"
    bl_label = "Hide Repetition"
    bl_options = {"UNDO"}

    remove: BoolProperty(
        name="Remove",
        description="Repeat the patch again",
        default=False,
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return has_model(cls, context) and is_ready(cls)

    def prepare(self, context: bpy.types.Context) -> Work:
        from ..nodes.material import group_of
        from ..nodes.packed_tables import stored, unpack
        from ..tables.coordinate_map import synthesize_coordinates

        self._material = context.object.active_material
        if self.remove:
            return lambda progress: None
        tables = unpack(stored(group_of(self._material)))

        def work(progress: Progress) -> Any:
            return synthesize_coordinates(tables, progress=progress)

        return work

    def finish(self, context: bpy.types.Context, result: Any) -> None:
        from ..nodes.material import set_coordinates

        set_coordinates(self._material, result)
