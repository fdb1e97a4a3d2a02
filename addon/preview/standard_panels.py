"""Blender's own panels for lights, cameras, worlds and output, shown with our engine too."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

SAME_AS = "BLENDER_RENDER"
"""The name under which Blender's panels say that any engine may show them."""

WITHOUT = {"VIEWLAYER_PT_filter", "VIEWLAYER_PT_layer_passes"}
"""Settings of passes that our engine does not have."""

LIGHTS = ("DATA_PT_EEVEE_light", "DATA_PT_EEVEE_shadow")
"""Lights' strength, colour and size, which Blender writes once for each engine."""


def add(engine: str) -> None:
    """Show the standard panels with an engine."""
    for panel in _panels():
        panel.COMPAT_ENGINES.add(engine)


def remove(engine: str) -> None:
    """Take `add` back."""
    for panel in _panels():
        panel.COMPAT_ENGINES.discard(engine)


def _panels() -> Iterator[type]:
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", ())
        if panel.__name__ in LIGHTS or (SAME_AS in engines and panel.__name__ not in WITHOUT):
            yield panel
