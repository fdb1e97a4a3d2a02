"""Stop long work from the panel."""

import bpy

from .. import jobs


class NACRE_OT_cancel(bpy.types.Operator):
    """Stop the work under way; nothing half-written stays behind"""

    bl_idname = "nacre.cancel"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return jobs.running() is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        job = jobs.running()
        if job is not None:
            job.cancel()
        return {"FINISHED"}
