"""From a measured file to a dataset."""

import bpy

from .layout import SidebarPanel, draw_facts, draw_step, property_column


class NACRE_PT_import_btf(SidebarPanel, bpy.types.Panel):
    bl_label = "Import"

    def draw(self, context: bpy.types.Context) -> None:
        chosen = context.scene.nacre
        layout = property_column(self.layout)
        draw_step(layout, "nacre.import_btf", "IMPORT")
        layout.prop(chosen, "dataset")
        draw_facts(context, layout, chosen.dataset_facts)
