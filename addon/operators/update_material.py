"""A material brought up to date with the files of its models."""

from pathlib import Path
from typing import Any

import bpy

from ..jobs import JobOperator, Progress, Work
from .ready import is_ready


class NACRE_OT_update_material(JobOperator, bpy.types.Operator):
    """Read the models of the active material again, and show them in place"""

    bl_idname = "nacre.update_material"
    bl_label = "Update Material"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        from ..nodes.material import is_nacre_material

        if context.object is None or not is_nacre_material(context.object.active_material):
            cls.poll_message_set("Select an object whose material shows a model")
            return False
        return is_ready(cls)

    def prepare(self, context: bpy.types.Context) -> Work:
        from ..models.exr import load_model
        from ..tables.tables import build_tables

        self._material = context.object.active_material
        chosen = self._material.nacre
        names = [chosen.model, *([chosen.final_model] if chosen.final_model else [])]
        paths = [Path(bpy.path.abspath(name)) for name in names]

        def work(progress: Progress) -> Any:
            def share(number: int) -> Progress:
                return lambda f, text: progress((number + f) / len(paths), text)

            return [
                build_tables(load_model(path), progress=share(number))
                for number, path in enumerate(paths)
            ]

        return work

    def finish(self, context: bpy.types.Context, result: Any) -> None:
        from ..nodes.material import set_final_tables, set_tables

        shown, *final = result
        set_tables(self._material, shown)
        set_final_tables(self._material, final[0] if final else None)
        self.report({"INFO"}, f"Updated the material {self._material.name}")
