"""The active object's material, when it shows a model."""

import bpy

from .layout import SidebarPanel, draw_step, draw_text, property_column


class NACRE_PT_active_material(SidebarPanel, bpy.types.Panel):
    bl_label = "Active Material"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not super().poll(context) or context.object is None:
            return False
        from ..nodes.material import is_nacre_material

        return is_nacre_material(context.object.active_material)

    def draw(self, context: bpy.types.Context) -> None:
        from ..nodes.material import MODEL_NODE, group_of
        from ..nodes.packed_tables import is_sparse
        from ..nodes.shown import what_is_shown

        material = context.object.active_material
        layout = property_column(self.layout)
        layout.label(text=material.name, icon="MATERIAL", translate=False)
        layout.prop(material.nacre, "lights", placeholder="Scene")
        layout.prop(material.nacre, "shadows")
        repeat = material.node_tree.nodes.get("Repeat")
        if repeat is not None:
            column = layout.column(align=True)
            column.prop(repeat.inputs[1], "default_value", index=0, text="Repeat X")
            column.prop(repeat.inputs[1], "default_value", index=1, text="Y")
            column.operator("nacre.real_size", icon="DRIVER_DISTANCE")
        row = layout.row(align=True)
        row.operator("nacre.light_by_world", icon="WORLD")
        row.operator("nacre.light_by_world", text="", icon="X").remove = True
        row = layout.row(align=True)
        row.operator("nacre.hide_repetition", icon="TEXTURE")
        row.operator("nacre.hide_repetition", text="", icon="X").remove = True
        layout.prop(material.nacre, "model")
        if material.nacre.file_quality:
            column = layout.column(align=True)
            text = f"Quality / {material.nacre.file_quality}"
            column.prop(material.nacre, "quality", text=text, slider=True)
            if not material.nacre.final_model:
                column.prop(material.nacre, "final_quality", text="Final", slider=True)
        if material.nacre.problem:
            draw_text(context, layout, material.nacre.problem, icon="ERROR")
        note = what_is_shown(context.scene, material)
        if note:
            draw_text(context, layout, note, icon="ERROR")
        if is_sparse(group_of(material)):
            layout.prop(material.nacre, "blended", placeholder="None")
            mix = material.node_tree.nodes[MODEL_NODE].inputs.get("Mix")
            if mix is not None and not mix.is_linked:
                layout.prop(mix, "default_value", text="Mix", slider=True)
        layout.prop(material.nacre, "occlusion", placeholder="None")
        layout.prop(material.nacre, "final_model", placeholder="Same")
        draw_step(layout, "nacre.update_material", "FILE_REFRESH")
