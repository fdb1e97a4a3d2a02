"""A scene's camera view drawn by Nacre's engine into memory."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import gpu
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..errors import NacreError
from .appearance import Appearance, appearance_of
from .context import need_gpu
from .draw import Resources, draw, prepare, world_colour
from .view import View

SAMPLES = 8
"""Pictures that are averaged against jagged edges."""


def camera_picture(
    depsgraph: bpy.types.Depsgraph,
    size: tuple[int, int],
    samples: int = SAMPLES,
    appearance: Callable[[bpy.types.Material | None], Appearance] = appearance_of,
) -> tuple[NDArray[np.float32], tuple[str, ...]]:
    """Linear pixels (height, width, 4) with premultiplied alpha, bottom row first; and messages.

    Raises NacreError without a GPU or a camera.
    """
    need_gpu()
    scene = depsgraph.scene
    if scene.camera is None:
        raise NacreError("the scene has no camera: add one to render")
    width, height = size
    resources = Resources()
    total = np.zeros((height, width, 4), np.float32)
    prepared = prepare(depsgraph, resources, appearance)
    screen = gpu.types.GPUOffScreen(width, height, format="RGBA32F")
    try:
        with screen.bind():
            buffer = gpu.state.active_framebuffer_get()
            for place in sample_places(samples):
                buffer.clear(color=background(scene), depth=1.0)
                draw(prepared, camera_view(depsgraph, size, place), resources)
                pixels = buffer.read_color(0, 0, width, height, 4, 0, "FLOAT")
                total += np.array(pixels, np.float32).reshape(height, width, 4)
    finally:
        screen.free()
    return total / samples, prepared.messages


def background(scene: bpy.types.Scene) -> tuple[float, float, float, float]:
    """The world's plain colour, or nothing where the film is transparent."""
    if scene.render.film_transparent:
        return (0.0, 0.0, 0.0, 0.0)
    return (*world_colour(scene.world), 1.0)


def camera_view(
    depsgraph: bpy.types.Depsgraph, size: tuple[int, int], place: tuple[float, float]
) -> View:
    """The camera's view, moved by a part of a pixel."""
    scene = depsgraph.scene
    camera = scene.camera.evaluated_get(depsgraph)
    window = camera.calc_matrix_camera(
        depsgraph,
        x=size[0],
        y=size[1],
        scale_x=scene.render.pixel_aspect_x,
        scale_y=scene.render.pixel_aspect_y,
    )
    view = View.of(camera.matrix_world.inverted(), window)
    moved = Matrix.Translation((2 * place[0] / size[0], 2 * place[1] / size[1], 0.0))
    return View(moved @ view.projection, view.viewer)


def sample_places(count: int) -> list[tuple[float, float]]:
    """Places in a pixel, from its middle, their mean (Roberts, R2 sequence, 2018)."""
    golden = 1.324717957244746
    numbers = np.arange(count)[:, None] / np.array([golden, golden**2])
    places = (0.5 + numbers) % 1.0
    return [(float(x), float(y)) for x, y in places - places.mean(0)]
