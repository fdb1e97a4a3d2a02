"""A material as large as the patch that was measured."""

import bpy

from ..errors import NacreError
from .ready import is_ready


class NACRE_OT_real_size(bpy.types.Operator):
    """Repeat the active material so that it is as large on the active object as it was measured"""

    bl_idname = "nacre.real_size"
    bl_label = "Real Size"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        from ..nodes.material import is_nacre_material

        item = context.object
        if item is None or item.type != "MESH" or not is_nacre_material(item.active_material):
            cls.poll_message_set("Select a mesh whose material shows a model")
            return False
        if not all(item.active_material.nacre.patch_size):
            cls.poll_message_set("The model does not say how large its patch is")
            return False
        return is_ready(cls)

    def execute(self, context: bpy.types.Context) -> set[str]:
        from ..nodes.material import set_repeat
        from ..nodes.real_size import metres_of_uv

        material = context.object.active_material
        try:
            metres = metres_of_uv(context.object)
        except NacreError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        set_repeat(material, *(metres / size for size in material.nacre.patch_size))
        return {"FINISHED"}
