"""The scene in EEVEE beside Cycles; the same in the 3D viewport and in the image editor."""

import bpy

from .layout import SidebarPanel, draw_facts, draw_step, property_column


class NACRE_PT_compare_with_cycles(SidebarPanel, bpy.types.Panel):
    bl_label = "Compare with Cycles"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        chosen = context.scene.nacre.comparison
        layout = property_column(self.layout)
        draw_step(layout, "nacre.compare_with_cycles", "IMAGE_DATA")
        if chosen.facts:
            layout.prop(chosen, "wipe", slider=True)
            draw_facts(context, layout, chosen.facts)


class NACRE_PT_compare_in_images(NACRE_PT_compare_with_cycles):
    bl_space_type = "IMAGE_EDITOR"
    bl_options = set()
