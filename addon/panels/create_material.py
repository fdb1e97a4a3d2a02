"""From a model to a material."""

import bpy

from .layout import SidebarPanel, draw_facts, draw_step, property_column


class NACRE_PT_create_material(SidebarPanel, bpy.types.Panel):
    bl_label = "Material"

    def draw(self, context: bpy.types.Context) -> None:
        chosen = context.scene.nacre
        layout = property_column(self.layout)
        layout.prop(chosen, "model")
        draw_facts(context, layout, chosen.model_facts)
        layout.prop(chosen, "lights", placeholder="Scene")
        draw_step(layout, "nacre.create_material", "MATERIAL")
