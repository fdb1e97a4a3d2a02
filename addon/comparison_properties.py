"""What a scene keeps of its comparison with Cycles."""

import bpy
from bpy.props import FloatProperty, StringProperty


def _wipe_set(self: "NACRE_PG_comparison", _context: bpy.types.Context) -> None:
    from .render.comparison import draw_wipe

    draw_wipe(self.wipe)


class NACRE_PG_comparison(bpy.types.PropertyGroup):
    """Two pictures as one."""

    wipe: FloatProperty(
        name="Wipe",
        description="How far EEVEE's picture reaches from the left; the rest is Cycles'",
        subtype="FACTOR",
        default=0.5,
        min=0.0,
        max=1.0,
        update=_wipe_set,
    )
    facts: StringProperty(options={"HIDDEN"})
