"""Depth maps of what lights see: one for a sun, a spot and a sample of an area, six for a point."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import atan, tan

import gpu
import numpy as np
from mathutils import Matrix, Vector

from .lights import Light
from .shader import let_go
from .surface_shader import SHADOW_VIEWS
from .view import View

SIZE = 1024
"""Texels along a shadow map."""

NEAR = 0.01  # of the far plane

Draw = Callable[[View], None]
"""Draws everything that casts shadows, as a light sees it, into the bound frame buffer."""


@dataclass(frozen=True)
class ShadowMaps:
    """Depth maps, the lights' views (n, 4, 4) that they were drawn with, and of each light that has
    any its first layer and the width of a texel: a sun's in metres, else at 1 m."""

    maps: gpu.types.GPUTexture | None
    views: np.ndarray
    places: dict[Light, tuple[int, float]]


def draw_shadow_maps(lights: Sequence[Light], bounds: np.ndarray, draw_casters: Draw) -> ShadowMaps:
    """Shadow maps of as many lights as there are layers; `bounds` (2, 3) holds all casters."""
    views: list[View] = []
    places: dict[Light, tuple[int, float]] = {}
    for light in lights:
        faces = light_views(light, bounds) if light.shadow and light not in places else []
        if faces and len(views) + len(faces) <= SHADOW_VIEWS:
            places[light] = len(views), texel_width(light, bounds)
            views += [View(face, light.viewer) for face in faces]
    packed = np.zeros((SHADOW_VIEWS, 4, 4), np.float32)
    for row, view in zip(packed, views, strict=False):
        row[:] = np.array(view.projection).T
    if not views:
        return ShadowMaps(None, packed, places)
    maps = gpu.types.GPUTexture((SIZE, SIZE), layers=len(views), format="DEPTH_COMPONENT32F")
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    for layer, view in enumerate(views):
        target = gpu.types.GPUFrameBuffer(depth_slot={"texture": maps, "layer": layer})
        with target.bind():
            target.clear(depth=1.0)
            target.viewport_set(0, 0, SIZE, SIZE)
            draw_casters(view)
    let_go()
    return ShadowMaps(maps, packed, places)


def light_views(light: Light, bounds: np.ndarray) -> list[Matrix]:
    """World to clip space of a light's maps."""
    middle, radius = Vector(bounds.mean(0)), _radius(bounds)
    if light.kind == "SUN":
        turn = light.axis.to_track_quat("Z", "Y").to_matrix().to_4x4()
        world = (Matrix.Translation(middle) @ turn).inverted()
        return [Matrix.Diagonal((1 / radius, 1 / radius, -1 / radius, 1.0)) @ world]
    far = max((middle - light.position).length + radius, 1e-3)
    if light.kind == "POINT":
        angle = 2 * atan(1 + 4 / SIZE)  # two texels beyond the edge, where faces are mixed
        axes = [Vector(sign * row) for row in np.eye(3) for sign in (1.0, -1.0)]
        return [_perspective(light.position, -axis, angle, far) for axis in axes]
    return [_perspective(light.position, light.axis, light.spread, far)]


def texel_width(light: Light, bounds: np.ndarray) -> float:
    """The width of a shadow texel: of a sun in metres, of others at 1 m."""
    if light.kind == "SUN":
        return 2 * _radius(bounds) / SIZE
    return 2 * tan((np.pi / 2 if light.kind == "POINT" else light.spread) / 2) / SIZE


def _radius(bounds: np.ndarray) -> float:
    return max(float(np.linalg.norm(bounds[1] - bounds[0])) / 2 * 1.01, 1e-4)


def _perspective(position: Vector, axis: Vector, angle: float, far: float) -> Matrix:
    """A view along -axis with a full angle."""
    near, scale = NEAR * far, 1 / tan(angle / 2)
    turn = axis.to_track_quat("Z", "Y").to_matrix().to_4x4()
    depth = (far + near) / (near - far), 2 * far * near / (near - far)
    clip = Matrix(((scale, 0, 0, 0), (0, scale, 0, 0), (0, 0, *depth), (0, 0, -1, 0)))
    return clip @ (Matrix.Translation(position) @ turn).inverted()
