"""Lights of a scene as the engine's uniform buffer takes them."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi

import bpy
import numpy as np
from mathutils import Matrix, Vector

LIGHTS = 256
"""Lights that fit a uniform buffer of 16 kB, which every driver takes."""

POINT, SUN, SPOT, AREA = 0.0, 1.0, 2.0, 3.0
AREA_SAMPLES = 2  # along each side


@dataclass(frozen=True)
class Light:
    """One light, or one sample of an area: a white perfect diffuser that it lights head-on shows
    `radiance`, at one metre where light spreads. `axis` points away from where it shines."""

    kind: float
    position: Vector
    axis: Vector
    radiance: tuple[float, float, float]
    cone: tuple[float, float] = (0.0, 1.0)  # cosine of a spot's edge, and from there to full light
    spread: float = pi / 2  # full angle that a shadow map has to see
    shadow: bool = True


def scene_lights(depsgraph: bpy.types.Depsgraph) -> list[Light]:
    """The lights of a scene, area lights by a few samples; instances too."""
    return [
        light
        for instance in depsgraph.object_instances
        if instance.object.type == "LIGHT" and instance.show_self
        for light in lights_of(instance.object.data, instance.matrix_world)
    ]


def lights_of(data: bpy.types.Light, matrix: Matrix) -> list[Light]:
    """A light at a place in the world."""
    colour = np.array(data.color[:])
    if getattr(data, "use_temperature", False):
        colour = colour * np.array(data.temperature_color[:3])
    power = colour * data.energy * 2.0 ** getattr(data, "exposure", 0.0)
    position = matrix.translation.copy()
    axis = matrix.to_quaternion() @ Vector((0.0, 0.0, 1.0))
    shadow = data.use_shadow
    if data.type == "SUN":
        return [Light(SUN, position, axis, tuple(power / pi), shadow=shadow)]
    if data.type == "POINT":
        return [Light(POINT, position, axis, tuple(power / (4 * pi**2)), shadow=shadow)]
    if data.type == "SPOT":
        edge = cos(data.spot_size / 2)
        cone = (edge, max((1.0 - edge) * data.spot_blend, 1e-4))
        radiance = tuple(power / (4 * pi**2))
        return [Light(SPOT, position, axis, radiance, cone, min(data.spot_size, 0.9 * pi), shadow)]
    # A perfect diffuse emitter: power / pi in the direction of its axis.
    wide = data.size
    high = data.size_y if data.shape in {"RECTANGLE", "ELLIPSE"} else data.size
    inset = 1.0 if data.shape in {"SQUARE", "RECTANGLE"} else pi / 4  # equal second moments, nearly
    steps = (np.arange(AREA_SAMPLES) + 0.5) / AREA_SAMPLES - 0.5
    radiance = tuple(power / (pi**2 * AREA_SAMPLES**2))
    return [
        Light(
            AREA,
            matrix @ Vector((x * wide * inset, y * high * inset, 0.0)),
            axis,
            radiance,
            spread=0.85 * pi,
            shadow=shadow,
        )
        for x in steps
        for y in steps
    ]


def light_rows(lights: list[Light], layers: list[int], texels: list[float]) -> np.ndarray:
    """Rows (LIGHTS, 4, 4) of the uniform buffer: position and kind, axis and first shadow layer (-1
    for none), radiance, cone and the width of a shadow texel (of a sun in metres, else at 1 m)."""
    rows = np.zeros((LIGHTS, 4, 4), np.float32)
    for row, light, layer, texel in zip(rows, lights, layers, texels, strict=False):
        row[0] = (*light.position, light.kind)
        row[1] = (*light.axis, layer)
        row[2] = (*light.radiance, 0.0)
        row[3] = (*light.cone, 0.0, texel)
    return rows
