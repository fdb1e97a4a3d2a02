"""Render settings of the engines, for pictures that can be compared with each other."""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import NacreError
from ..models.exr import read_picture
from ..osl import has_osl
from ..preview.context import need_gpu

NODE_ENGINES = ("eevee", "cycles")
"""Those that evaluate node groups."""

ENGINES = (*NODE_ENGINES, "glsl")
FORMATS = {".exr": ("OPEN_EXR", "32"), ".png": ("PNG", "8")}


def engines_here() -> tuple[str, ...]:
    """The engines that this Blender can render with now."""
    try:
        need_gpu()
    except NacreError:
        return NODE_ENGINES
    return ENGINES


def check_picture(path: str | Path, engine: str) -> None:
    """Raise NacreError, before any work, for a picture that cannot be made."""
    path = Path(path)
    if engine not in ENGINES:
        raise NacreError(f"engine {engine!r}: expected one of {', '.join(ENGINES)}")
    if engine == "glsl":
        need_gpu()
    if path.suffix.lower() not in FORMATS:
        raise NacreError(f"{path}: pictures are written as .exr or .png")
    if not path.parent.is_dir():
        raise NacreError(f"{path.parent}: no such folder; make it first")


def set_engine(scene: bpy.types.Scene, engine: str, samples: int) -> None:
    """Select EEVEE or Cycles with a number of samples a pixel and nothing that alters values."""
    scene.render.engine = engine_id(engine)
    if engine == "eevee":
        scene.eevee.taa_render_samples = samples
    elif engine == "cycles":
        scene.cycles.samples = samples
        scene.cycles.use_adaptive_sampling = False
        scene.cycles.use_denoising = False
        if hasattr(scene.render, "use_texture_cache"):
            scene.render.use_texture_cache = False


def use_scripts(scene: bpy.types.Scene, material: bpy.types.Material) -> None:
    """Let Cycles run the scripts of a material. Raises NacreError where it cannot."""
    from ..nodes.material import needs_osl  # models need the compiled packages

    if scene.render.engine == "CYCLES" and needs_osl(material):
        if not has_osl():
            raise NacreError(
                "Cycles shows sparse models with Open Shading Language, which this Blender was "
                "built without"
            )
        scene.cycles.device, scene.cycles.shading_system = "CPU", True


def engine_id(engine: str) -> str:
    """Blender's name of an engine."""
    if engine not in ENGINES:
        raise ValueError(f"engine: expected one of {ENGINES}, got {engine!r}")
    if engine == "cycles":
        return "CYCLES"
    return "BLENDER_EEVEE" if bpy.app.version >= (5, 0) else "BLENDER_EEVEE_NEXT"


def set_format(scene: bpy.types.Scene, path: Path) -> None:
    """Pictures of a scene as a linear .exr or a .png in Blender's Standard view."""
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):  # 5.x
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_depth = FORMATS[path.suffix.lower()]
    settings.color_mode = "RGB"
    scene.view_settings.view_transform = "Standard"


def render_to(scene: bpy.types.Scene, path: str | Path) -> None:
    """Render a scene to a linear .exr or a .png in Blender's Standard view."""
    path = Path(path)
    set_format(scene, path)
    scene.render.filepath = str(path.resolve())
    scene.render.use_file_extension = False
    bpy.ops.render.render(write_still=True, scene=scene.name)
    if not path.is_file():
        raise NacreError(f"{path}: the picture could not be written; is the folder writable?")


def render_pixels(scene: bpy.types.Scene) -> NDArray[np.float32]:
    """Render a scene to linear pixels (height, width, 3), bottom row first."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.exr"
        render_to(scene, path)
        return read_picture(path)
