"""Cycles as a measuring device: its settings, its light, and pictures as arrays."""

from __future__ import annotations

import tempfile
from math import pi
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
from mathutils import Vector

from ..errors import NacreError
from ..render.engines import set_engine


def set_up_cycles(scene: bpy.types.Scene, samples: int, bounces: int) -> None:
    """Cycles on the CPU with nothing that alters values, in a scene of the user's present frame."""
    user = bpy.context.scene
    scene.frame_set(user.frame_current, subframe=user.frame_subframe)
    scene.world = None
    set_engine(scene, "cycles", samples)
    cycles = scene.cycles
    cycles.device = "CPU"  # OSL cameras run there everywhere
    cycles.pixel_filter_type = "BOX"  # exactly one texel
    cycles.use_light_tree = False  # there is one light
    # Blender's defaults, said here because they matter: a little energy of caustics for much less
    # noise. Light that comes straight from the lamp is never bounded.
    cycles.blur_glossy, cycles.sample_clamp_indirect = 1.0, 10.0
    cycles.sample_clamp_direct = 0.0
    cycles.max_bounces = bounces
    for kind in ("diffuse", "glossy", "transmission"):
        setattr(cycles, f"{kind}_bounces", bounces)
    scene.cycles_curves.shape = "THICK"
    scene.render.film_transparent = True
    scene.render.use_persistent_data = True  # keeps the geometry from one light to the next
    scene.render.use_compositing = scene.render.use_sequencer = False


def add_light(scene: bpy.types.Scene) -> bpy.types.Object:
    """A sun without size under which a white diffuser lit head-on reads 1."""
    sun = bpy.data.lights.new("Light", "SUN")
    sun.energy, sun.angle = pi, 0.0
    item = bpy.data.objects.new("Light", sun)
    item.rotation_mode = "QUATERNION"
    scene.collection.objects.link(item)
    return item


def aim(item: bpy.types.Object, direction: np.ndarray) -> None:
    """Let the light come from a direction (3,)."""
    item.rotation_quaternion = Vector(direction).to_track_quat("Z", "Y")


def render(
    scene: bpy.types.Scene, seed: int, strip: tuple[float, float] = (0.0, 1.0)
) -> dict[str, np.ndarray]:
    """The passes of one picture, (height, width, channels) float32 each, bottom row first.

    "Combined" is linear RGB and coverage; others are there as the scene's view layer asks for them.
    `strip` is the part of the height to render, from the bottom; its pixels are those of the whole
    picture. Raises NacreError when Blender could not write the picture.
    """
    scene.cycles.seed = seed
    frame = scene.render
    frame.use_border = frame.use_crop_to_border = strip != (0.0, 1.0)
    frame.border_min_x, frame.border_max_x = 0.0, 1.0
    frame.border_min_y, frame.border_max_y = strip
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):  # 5.x
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER"
    settings.color_depth, settings.color_mode, settings.exr_codec = "32", "RGBA", "NONE"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.exr"
        scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True, scene=scene.name)
        if not path.is_file():
            raise NacreError(f"no picture could be written to {folder}: is the disk full?")
        parts = OpenEXR.File(str(path)).parts
        layer = scene.view_layers[0].name + "."
        return {
            name.removeprefix(layer): np.asarray(channel.pixels, np.float32)[::-1]
            for part in parts
            for name, channel in part.channels.items()
        }
