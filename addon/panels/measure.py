"""From a piece of the scene to a dataset."""

import bpy

from .. import jobs
from ..datasets.direction_sets import direction_set
from ..errors import NacreError
from ..measure.settings import Settings
from ..measurement_properties import NACRE_PG_measurement, directions, item_to_measure
from .layout import SidebarPanel, draw_facts, draw_step, property_column


class NACRE_PT_measure(SidebarPanel, bpy.types.Panel):
    bl_label = "Measure"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        chosen = context.scene.nacre.measurement
        layout = property_column(self.layout)
        layout.prop(chosen, "what")
        _draw_item(context, layout, chosen)
        column = layout.column(align=True)
        column.prop(chosen, "width")
        column.prop(chosen, "height")
        layout.prop(chosen, "kind")
        layout.prop(chosen, "texels")
        _draw_directions(layout, chosen, "view")
        if chosen.kind == "BTF":
            _draw_directions(layout, chosen, "light")
            column = layout.column(align=True)
            column.prop(chosen, "use_noise_target")
            column.prop(chosen, "noise_db" if chosen.use_noise_target else "samples")
            layout.prop(chosen, "bounces")
            layout.prop(chosen, "seed")
        layout.prop(chosen, "output", placeholder="Beside the .blend file")
        draw_facts(context, layout, expected_dataset(chosen))
        _draw_button(context, layout, chosen)


def _draw_item(
    context: bpy.types.Context, layout: bpy.types.UILayout, chosen: NACRE_PG_measurement
) -> None:
    active = context.object
    placeholder = {"placeholder": active.name} if chosen.what == "OBJECT" and active else {}
    layout.prop(chosen, chosen.what.lower(), text="", **placeholder)


def _draw_directions(layout: bpy.types.UILayout, chosen: NACRE_PG_measurement, which: str) -> None:
    column = layout.column(align=True)
    column.prop(chosen, f"{which}s")
    kind = getattr(chosen, f"{which}s")
    if kind == "uniform":
        column.prop(chosen, f"{which}_count")
    elif kind == "csv":
        column.prop(chosen, f"{which}_file")


def _draw_button(
    context: bpy.types.Context, layout: bpy.types.UILayout, chosen: NACRE_PG_measurement
) -> None:
    """One button, or two where pictures of an unfinished measurement are there."""
    finished = _finished(chosen, item_to_measure(chosen, context))
    if not finished or jobs.running() is not None:
        draw_step(layout, "nacre.measure", "RENDER_STILL")
        return
    layout.label(text=f"Measured already: {finished} of the lights", icon="INFO")
    draw_step(layout, "nacre.measure", "PLAY", "Resume")
    layout.operator("nacre.measure", text="Start Over", icon="FILE_REFRESH").restart = True


def _finished(chosen: NACRE_PG_measurement, item: bpy.types.ID | None) -> int:
    from ..measure.unfinished import count_finished
    from ..operators.measure import dataset_to_write

    try:
        return count_finished(dataset_to_write(chosen, item)) if chosen.kind == "BTF" else 0
    except NacreError:
        return 0


def expected_dataset(chosen: NACRE_PG_measurement) -> str:
    """Facts of what a measurement will give; files of directions are left to when it begins."""
    from ..facts import size_text

    axes = ("light", "view") if chosen.kind == "BTF" else ("view",)
    if any(getattr(chosen, f"{axis}s") == "csv" for axis in axes):
        return ""
    counts = [len(direction_set(directions(chosen, axis))) for axis in axes]
    size = (chosen.width, chosen.height or chosen.width) if chosen.width > 0.0 else (1.0, 1.0)
    _, rows = Settings(chosen.texels).texels(size)
    numbers = chosen.texels * rows * (3 if chosen.kind == "BTF" else 1)
    for count in counts:
        numbers *= count
    directions_text = " × ".join(
        f"{count} {axis}s" for count, axis in zip(counts, axes, strict=True)
    )
    return (
        f"Directions\t{directions_text}\nTexels\t{chosen.texels} × {rows}\n"
        f"Size\t{size_text(2 * numbers)}"
    )
