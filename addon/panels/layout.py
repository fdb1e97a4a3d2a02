"""Pieces that the panels share."""

import textwrap

import bpy

from .. import jobs, wheels
from ..facts import parse_facts


class SidebarPanel:
    """Where Nacre's panels are; they make room when a compiled package is missing."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Nacre"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return wheels.missing() is None


def property_column(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """A column of properties with their names on the left, none of them to be animated."""
    layout.use_property_split = True
    layout.use_property_decorate = False
    return layout.column()


def draw_facts(context: bpy.types.Context, layout: bpy.types.UILayout, facts: str) -> None:
    """Facts aligned with the properties above them; a problem over the whole width."""
    if not facts:
        return
    column = layout.column(align=True)
    for name, value in parse_facts(facts):
        if not name:
            draw_text(context, column, value, icon="ERROR")
            continue
        row = column.split(factor=0.4)
        left = row.row()
        left.alignment = "RIGHT"
        left.label(text=name)
        row.label(text=value, translate=False)


def draw_text(
    context: bpy.types.Context, layout: bpy.types.UILayout, text: str, icon: str = "NONE"
) -> None:
    """A text in as many lines as the region's width asks for."""
    width = context.region.width / context.preferences.system.ui_scale
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(textwrap.wrap(text, max(16, round(width / 7 - 8)))):
        icon = icon if number == 0 else "BLANK1" if icon != "NONE" else icon
        column.label(text=line, icon=icon, translate=False)


def draw_step(layout: bpy.types.UILayout, operator: str, icon: str, text: str = "") -> None:
    """The button of a step, or its progress and a way out while it runs."""
    job = jobs.running()
    if job is None or job.owner != operator:
        row = layout.row()
        row.scale_y = 1.3
        row.operator(operator, icon=icon, **({"text": text} if text else {}))
        return
    row = layout.row(align=True)
    row.scale_y = 1.3
    row.progress(factor=job.fraction, text=job.text())
    row.operator("nacre.cancel", text="", icon="X")
    layout.label(text=job.message)
