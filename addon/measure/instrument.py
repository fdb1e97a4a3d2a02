"""A scene of its own in which Cycles looks at a patch from every view in one picture."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ..errors import NacreError
from ..render.stage import new_scene
from .camera import Tiles, add_hemisphere_camera
from .cycles import set_up_cycles
from .patch import Patch, is_displaced, place
from .top_view import measure_top_view

# Texels along a side that the height of displaced surfaces is found with.
_HEIGHT_TEXELS = 32

# Below this height above the horizon a view or light would need endless neighbours.
LOWEST_Z = 0.01


@contextmanager
def new_instrument(
    patch: Patch,
    view: np.ndarray,
    light: np.ndarray,
    texels: tuple[int, int],
    samples: int,
    bounces: int = 0,
    *,
    centred: bool = False,
) -> Iterator[tuple[bpy.types.Scene, Tiles]]:
    """A dark scene with the patch, its neighbours and the camera, removed at the end.

    `view` (V, 3) and `light` (L, 3, L may be 0) are unit vectors, `texels` (x, y), `samples` the
    paths through each texel and `bounces` how often light goes on from where it first arrives.
    Raises NacreError for directions at or below the horizon.
    """
    for name, directions in (("view", view), ("light", light)):
        if len(directions) and directions[:, 2].min() < LOWEST_Z:
            raise NacreError(f"a {name} direction lies at or below the horizon: leave it out")
    tiles = Tiles(len(view), texels)
    displaced = _heights(patch) if is_displaced(patch) else None
    with new_scene(tiles.picture_size) as scene:
        set_up_cycles(scene, samples, bounces)
        slope = _steepest(view) + (_steepest(light) if len(light) else 0.0)
        top = place(scene, patch, slope, displaced)
        # Well above the patch, and not so far that positions lose digits.
        height = top + 0.1 * max(patch.size)
        add_hemisphere_camera(scene, view, tiles, patch.size, height, centred)
        yield scene, tiles


def _steepest(directions: np.ndarray) -> float:
    """The largest tan(theta)."""
    return float((np.hypot(directions[:, 0], directions[:, 1]) / directions[:, 2]).max())


def _heights(patch: Patch) -> tuple[float, float]:
    """The lowest and highest point in metres that is seen from above."""
    height = measure_top_view(patch, (_HEIGHT_TEXELS, _HEIGHT_TEXELS))["height"]
    return float(height.min()), float(height.max())
