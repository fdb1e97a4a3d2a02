"""A scene of its own in which Cycles looks at a patch from every view."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

import bpy
import numpy as np

from ..errors import NacreError
from ..osl import has_osl
from ..render.stage import new_scene
from .cycles import set_up_cycles
from .hemisphere_camera import HemisphereCamera
from .oblique_camera import ObliqueCamera
from .patch import Patch, place
from .tiles import Tiles
from .top_view import measure_top_view

# Texels along a side that the height of displaced surfaces is found with.
_HEIGHT_TEXELS = 32

# Below this height above the horizon a view or light would need endless neighbours.
LOWEST_Z = 0.01


@dataclass(frozen=True)
class Instrument:
    """The scene, how its views are grouped in rows, and the camera."""

    scene: bpy.types.Scene
    tiles: Tiles
    camera: HemisphereCamera | ObliqueCamera

    def picture(self, seed: int, row: int | None = None) -> np.ndarray:
        """Linear RGB and coverage (view, y, x, 4) float32, y upward, of all views or of one row of
        tiles, which is the same as in the whole picture of that seed."""
        return self.camera.take(seed, row)


def program() -> str:
    """What takes the pictures: other programs give other noise."""
    camera = "all views in one picture" if has_osl() else "a picture a view, without OSL"
    return f"Cycles {bpy.app.version_string}, {camera}"


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
) -> Iterator[Instrument]:
    """A dark scene with the patch, its neighbours and a camera, removed at the end.

    `view` (V, 3) and `light` (L, 3, L may be 0) are unit vectors, `texels` (x, y), `samples` the
    paths through each texel and `bounces` how often light goes on from where it first arrives.
    Raises NacreError for directions at or below the horizon.
    """
    for name, directions in (("view", view), ("light", light)):
        if len(directions) and directions[:, 2].min() < LOWEST_Z:
            raise NacreError(f"a {name} direction lies at or below the horizon: leave it out")
    tiles = Tiles(len(view), texels)
    with new_scene(texels) as scene:
        set_up_cycles(scene, samples, bounces)
        slope = _steepest(view) + (_steepest(light) if len(light) else 0.0)
        top = place(scene, patch, slope, partial(_heights, patch))
        # Well above the patch, and not so far that positions lose digits.
        height = top + 0.1 * max(patch.size)
        camera = HemisphereCamera if has_osl() else ObliqueCamera
        yield Instrument(scene, tiles, camera(scene, view, tiles, patch.size, height, centred))


def _steepest(directions: np.ndarray) -> float:
    """The largest tan(theta)."""
    return float((np.hypot(directions[:, 0], directions[:, 1]) / directions[:, 2]).max())


def _heights(patch: Patch) -> tuple[float, float]:
    """The lowest and highest point in metres that is seen from above."""
    height = measure_top_view(patch, (_HEIGHT_TEXELS, _HEIGHT_TEXELS))["height"]
    return float(height.min()), float(height.max())
