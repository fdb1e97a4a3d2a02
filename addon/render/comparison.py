"""The user's scene as two engines render it, beside each other in the image editor."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import NacreError
from ..models.exr import read_picture
from .engines import engine_id, render_to

ENGINES = ("eevee", "cycles")
"""What is compared: the viewport's way to see a model, and Cycles."""

IMAGES = {"eevee": "Nacre EEVEE", "cycles": "Nacre Cycles", "difference": "Nacre Difference"}
WIPE = "Nacre Compare"

Pixels = NDArray[np.float32]

# What a render here changes in a scene, and gives back.
_RENDER = ("engine", "filepath", "use_file_extension", "use_compositing", "use_sequencer")
_FILE = ("media_type", "file_format", "color_mode", "color_depth")


def scene_pixels(scene: bpy.types.Scene, engine: str) -> Pixels:
    """A scene as its camera sees it, linear (height, width, 3), bottom row first; see
    `render_scene`."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.exr"
        render_scene(scene, engine, path)
        return read_picture(path)


def render_scene(scene: bpy.types.Scene, engine: str, path: Path) -> None:
    """Render what a scene's camera sees to a picture file.

    With the scene's own settings for that engine, before its compositor; the scene is left as it
    was. Raises NacreError without a camera.
    """
    if scene.camera is None:
        raise NacreError("the scene has no camera: add one to compare what it sees")
    with _kept(scene):
        scene.render.engine = engine_id(engine)
        scene.render.use_compositing = scene.render.use_sequencer = False
        render_to(scene, path)


@contextmanager
def _kept(scene: bpy.types.Scene) -> Iterator[None]:
    """Give back the settings that a render to a file needs otherwise."""
    image, view = scene.render.image_settings, scene.view_settings
    # The kind of medium first: it says which formats there are, and they which depths.
    kept = [(scene.render, name) for name in _RENDER]
    kept += [(image, name) for name in _FILE if hasattr(image, name)]
    kept.append((view, "view_transform"))
    values = [getattr(owner, name) for owner, name in kept]
    look = view.look
    try:
        yield
    finally:
        for (owner, name), value in zip(kept, values, strict=True):
            setattr(owner, name, value)
        view.look = look  # each view has looks of its own


def differences(first: Pixels, second: Pixels) -> dict[str, float]:
    """PSNR in dB with the second's largest value as peak, and the mean absolute difference, also
    relative to the second's mean."""
    difference = np.abs(first - second)
    square = float(np.square(difference, dtype=float).mean())
    peak = float(second.max())
    return {
        "psnr_db": float(10 * np.log10(peak**2 / square)) if square and peak else float("inf"),
        "mean_abs": float(difference.mean()),
        "relative": float(difference.mean() / max(float(second.mean()), 1e-12)),
    }


def show(pictures: dict[str, Pixels], wipe: float) -> bpy.types.Image:
    """Put two pictures of one size, by ENGINES, and their difference into images, and a wipe."""
    first, second = (pictures[engine] for engine in ENGINES)
    for kind, pixels in {**pictures, "difference": np.abs(first - second)}.items():
        _write(IMAGES[kind], pixels).pack()  # or undo would take them
    return draw_wipe(wipe)


def draw_wipe(wipe: float) -> bpy.types.Image | None:
    """One image of both pictures: the first up to a fraction of the width, then the second.

    None before there are any.
    """
    images = [bpy.data.images.get(IMAGES[engine]) for engine in ENGINES]
    if None in images:
        return None
    first, second = (_read(image) for image in images)
    column = round(wipe * first.shape[1])
    return _write(WIPE, np.concatenate([first[:, :column], second[:, column:]], 1))


def _read(image: bpy.types.Image) -> Pixels:
    pixels = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(image.size[1], image.size[0], 4)[..., :3]


def _write(name: str, pixels: Pixels) -> bpy.types.Image:
    """An image of linear pixels (height, width, 3), which keeps its place in the editors."""
    height, width, _ = pixels.shape
    image = bpy.data.images.get(name)
    if image is None:
        image = bpy.data.images.new(name, width, height, float_buffer=True)
        image.use_view_as_render = True
    if tuple(image.size) != (width, height):
        image.scale(width, height)
    opaque = np.ones((height, width, 4), np.float32)
    opaque[..., :3] = pixels
    image.pixels.foreach_set(opaque.ravel())
    image.update()
    return image
