"""What an engine shows of a material in another way than it is, for the user."""

from __future__ import annotations

import bpy

from ..osl import has_osl
from .loops import has_zones
from .material import needs_osl


def what_is_shown(scene: bpy.types.Scene, material: bpy.types.Material) -> str:
    """One line, or "" where the scene's engine shows a model as it is."""
    if not needs_osl(material):
        return ""
    if scene.render.engine == "CYCLES":
        return _in_cycles(scene)
    if scene.render.engine.startswith("BLENDER_EEVEE") and not has_zones():
        return "EEVEE cannot loop in this Blender: it shows a K-CTA fit of the sparse model"
    return ""


def _in_cycles(scene: bpy.types.Scene) -> str:
    average = "Cycles shows only the average colour of this sparse model: "
    if not has_osl():
        return average + "this Blender was built without Open Shading Language"
    if scene.cycles.device != "CPU":
        return average + "set the device to CPU, and turn on Open Shading Language"
    if not scene.cycles.shading_system:
        return average + "turn on Open Shading Language in the render settings"
    return ""
