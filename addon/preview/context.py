"""Whether there is a graphics context to draw with."""

from __future__ import annotations

import bpy
import gpu

from ..errors import NacreError


def need_gpu() -> None:
    """Make the GPU ready in background. Raises NacreError where Blender cannot."""
    if not bpy.app.background:
        return
    if not hasattr(gpu, "init"):
        raise NacreError(
            "Nacre's engine cannot draw in background before Blender 5.2: render with EEVEE or "
            "Cycles, or in a window"
        )
    try:
        gpu.init()
    except SystemError as error:
        raise NacreError(f"no graphics context for Nacre's engine ({error})") from error
