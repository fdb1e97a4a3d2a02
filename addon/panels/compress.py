"""From a dataset to a model."""

import bpy

from ..properties import TARGETS
from .layout import SidebarPanel, draw_facts, draw_step, property_column


class NACRE_PT_compress(SidebarPanel, bpy.types.Panel):
    bl_label = "Compress"

    def draw(self, context: bpy.types.Context) -> None:
        chosen = context.scene.nacre
        layout = property_column(self.layout)
        layout.prop(chosen, "method")
        if chosen.method == "SPARSE":
            layout.prop(chosen, "ensemble", placeholder="Nacre's own")
            layout.prop(chosen, "sparse_quality", slider=True)
        else:
            layout.prop(chosen, "quality")
            if chosen.quality in TARGETS:
                layout.prop(chosen, TARGETS[chosen.quality])
        layout.prop(chosen, "output", placeholder="Beside the dataset")
        if chosen.expected_size:
            draw_facts(context, layout, f"Size\t{chosen.expected_size}")
        draw_facts(context, layout, chosen.ensemble_facts)
        draw_step(layout, "nacre.compress", "MOD_MESHDEFORM")
