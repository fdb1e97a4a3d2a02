"""A scene of its own in which Cycles looks at a patch from every view in one picture."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from math import pi
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
from mathutils import Vector

from ..errors import NacreError
from ..render.engines import set_engine
from ..render.stage import new_scene
from .camera import Tiles, add_hemisphere_camera
from .patch import Patch, place

# Below this height above the horizon a view or light would need endless neighbours.
LOWEST_Z = 0.01


@contextmanager
def new_instrument(
    patch: Patch,
    view: np.ndarray,
    light: np.ndarray,
    texels: int,
    samples: int,
    *,
    centred: bool = False,
) -> Iterator[tuple[bpy.types.Scene, Tiles]]:
    """A dark scene with the patch, its neighbours and the camera, removed at the end.

    `view` (V, 3) and `light` (L, 3, L may be 0) are unit vectors, `samples` the paths through each
    texel. Raises NacreError for directions at or below the horizon.
    """
    for name, directions in (("view", view), ("light", light)):
        if len(directions) and directions[:, 2].min() < LOWEST_Z:
            raise NacreError(f"a {name} direction lies at or below the horizon: leave it out")
    tiles = Tiles(len(view), texels)
    with new_scene(tiles.picture_size) as scene:
        scene.world = None
        slope = _steepest(view) + (_steepest(light) if len(light) else 0.0)
        top = place(scene, patch, slope)
        # Well above the patch, and not so far that positions lose digits.
        height = top + 0.1 * patch.size
        add_hemisphere_camera(scene, view, tiles, patch.size, height, centred)
        _set_up_cycles(scene, samples)
        yield scene, tiles


def _steepest(directions: np.ndarray) -> float:
    """The largest tan(theta)."""
    return float((np.hypot(directions[:, 0], directions[:, 1]) / directions[:, 2]).max())


def _set_up_cycles(scene: bpy.types.Scene, samples: int) -> None:
    set_engine(scene, "cycles", samples)
    cycles = scene.cycles
    cycles.device = "CPU"  # OSL cameras run there everywhere
    cycles.pixel_filter_type = "BOX"  # exactly one texel
    cycles.use_light_tree = False  # there is one light
    # Blender's defaults, said here because they matter: a little energy of caustics for much less
    # noise. Light that comes straight from the lamp is never bounded.
    cycles.blur_glossy, cycles.sample_clamp_indirect = 1.0, 10.0
    cycles.sample_clamp_direct = 0.0
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


def render(scene: bpy.types.Scene, tiles: Tiles, seed: int) -> np.ndarray:
    """Linear RGB and coverage (view, y, x, 4) float32 of one picture; y grows upward."""
    scene.cycles.seed = seed
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):  # 5.x
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR", "32"
    settings.color_mode, settings.exr_codec = "RGBA", "NONE"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "views.exr"
        scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True, scene=scene.name)
        if not path.is_file():
            raise NacreError(f"no picture could be written to {folder}: is the disk full?")
        pixels = OpenEXR.File(str(path)).parts[0].channels["RGBA"].pixels
    return tiles.split(np.asarray(pixels, np.float32)[::-1])
