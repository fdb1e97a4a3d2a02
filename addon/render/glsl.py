"""Pictures of Nacre's own engine, without a material in between: tables are all it reads."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import NacreError
from ..preview.appearance import Appearance
from ..preview.flat import FlatEvaluator
from ..preview.picture import camera_picture
from ..preview.textures import laid_out
from ..tables.any_tables import AnyTables
from .engines import set_format
from .stage import add_camera, add_mesh, add_sun, new_scene, unit

Direction = tuple[float, float]


def flat_picture(
    tables: AnyTables,
    path: Path,
    light: Direction,
    view: Direction,
    size: tuple[int, int] | None = None,
) -> None:
    """Write the patch filling the picture, for a light and a view at (theta, phi) in degrees."""
    pixels = FlatEvaluator(tables).picture(unit(light), unit(view), size)
    write_picture(pixels, path)


def object_picture(
    tables: AnyTables,
    path: Path,
    mesh: str,
    size: tuple[int, int],
    light: Direction,
    view: Direction,
    samples: int,
) -> None:
    """Write an object under a sun; directions in degrees from the object's +z and +x."""
    shown = laid_out(tables)
    material = bpy.data.materials.new("Nacre")
    try:
        with new_scene(size) as scene:
            add_mesh(scene, mesh, material)
            add_camera(scene, view, 2.3 * max(1.0, size[0] / size[1]))
            add_sun(scene, light)
            layer = scene.view_layers[0]
            layer.update()
            pixels, _ = camera_picture(
                layer.depsgraph, size, samples, lambda _material: Appearance(btf=shown)
            )
    finally:
        bpy.data.materials.remove(material)
    write_picture(pixels[..., :3], path)


def write_picture(pixels: NDArray[np.floating], path: Path) -> None:
    """Linear pixels (height, width, 3), bottom row first, as a linear .exr or a .png in Blender's
    Standard view."""
    height, width, _ = pixels.shape
    image = bpy.data.images.new("Nacre", width, height, float_buffer=True)
    try:
        full = np.concatenate([pixels, np.ones((height, width, 1))], -1).astype(np.float32)
        image.pixels.foreach_set(full.ravel())
        with new_scene((width, height)) as scene:
            set_format(scene, path)
            image.save_render(str(path.resolve()), scene=scene)
    except RuntimeError as error:
        raise NacreError(f"{path}: the picture could not be written ({error})") from error
    finally:
        bpy.data.images.remove(image)
