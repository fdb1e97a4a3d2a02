"""Nacre without its compiled packages: what is missing, and for whom there is any."""

import bpy

from .. import wheels
from .layout import SidebarPanel, draw_text


class NACRE_PT_missing_wheels(SidebarPanel, bpy.types.Panel):
    bl_label = "Nacre Cannot Run Here"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return wheels.missing() is not None

    def draw(self, context: bpy.types.Context) -> None:
        draw_text(context, self.layout, wheels.missing() or "", icon="ERROR")
