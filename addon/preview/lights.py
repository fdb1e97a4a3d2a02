"""Lights of a scene as the engine's uniform buffer takes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, pi

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..nodes.light_group import AREA_SAMPLES, KINDS
from ..nodes.light_set import shining

LIGHTS = 255
"""Lights that fit a uniform buffer of 16 kB, which every driver takes, with their number."""


@dataclass(frozen=True)
class Light:
    """One light, or one sample of an area: a white perfect diffuser that it lights head-on shows
    `radiance`, at one metre where light spreads. `axis` points away from where it shines.

    Vectors are frozen, so that equal lights share their shadow maps.
    """

    kind: str  # of KINDS
    position: Vector
    axis: Vector
    radiance: tuple[float, float, float]
    cone: tuple[float, float] = (0.0, 1.0)  # cosine of a spot's edge, and from there to full light
    spread: float = pi / 2  # full angle that a shadow map has to see
    shadow: bool = True

    @property
    def viewer(self) -> tuple[float, float, float, float]:
        """Where it looks from: a point with 1, or a sun's direction with 0."""
        return (*self.axis, 0.0) if self.kind == "SUN" else (*self.position, 1.0)


def scene_lights(depsgraph: bpy.types.Depsgraph) -> list[Light]:
    """The lights of a scene, area lights by a few samples; instances too."""
    return [
        light
        for instance in depsgraph.object_instances
        if instance.object.type == "LIGHT" and instance.show_self
        for light in lights_of(instance.object.data, instance.matrix_world)
    ]


def collection_lights(
    collection: bpy.types.Collection, depsgraph: bpy.types.Depsgraph
) -> list[Light]:
    """The lights of a collection, those that the node groups follow."""
    items = [item.evaluated_get(depsgraph) for item in shining(collection)]
    return [light for item in items for light in lights_of(item.data, item.matrix_world)]


def lights_of(data: bpy.types.Light, matrix: Matrix) -> list[Light]:
    """A light at a place in the world."""
    colour = np.array(data.color[:])
    if getattr(data, "use_temperature", False):
        colour = colour * np.array(data.temperature_color[:3])
    power = colour * data.energy * 2.0 ** getattr(data, "exposure", 0.0)
    position = matrix.translation.copy().freeze()
    axis = (matrix.to_quaternion() @ Vector((0.0, 0.0, 1.0))).freeze()
    shadow = data.use_shadow
    if data.type == "SUN":
        return [Light("SUN", position, axis, _tuple(power / pi), shadow=shadow)]
    if data.type == "POINT":
        return [Light("POINT", position, axis, _tuple(power / (4 * pi**2)), shadow=shadow)]
    if data.type == "SPOT":
        edge = cos(data.spot_size / 2)
        cone = (edge, max((1.0 - edge) * data.spot_blend, 1e-4))
        radiance = _tuple(power / (4 * pi**2))
        spread = min(data.spot_size, 0.9 * pi)
        return [Light("SPOT", position, axis, radiance, cone, spread, shadow)]
    # A perfect diffuse emitter: power / pi in the direction of its axis.
    wide = data.size
    high = data.size_y if data.shape in {"RECTANGLE", "ELLIPSE"} else data.size
    radiance = _tuple(power / (pi**2 * len(AREA_SAMPLES)))
    places = (matrix @ Vector((x * wide, y * high, 0.0)) for x, y in AREA_SAMPLES)
    return [
        Light("AREA", place.freeze(), axis, radiance, spread=0.85 * pi, shadow=shadow)
        for place in places
    ]


def light_rows(
    lights: Sequence[Light], shadows: Mapping[Light, tuple[int, float]] | None = None
) -> np.ndarray:
    """The uniform buffer (1 + 4 LIGHTS, 4): the number of lights, then for each position and kind,
    axis and first shadow layer (-1 for none), radiance, cone and the width of a shadow texel (of a
    sun in metres, else at 1 m). `shadows` has layers and widths."""
    rows = np.zeros((1 + 4 * LIGHTS, 4), np.float32)
    rows[0, 0] = min(len(lights), LIGHTS)
    for row, light in zip(rows[1:].reshape(-1, 4, 4), lights, strict=False):
        layer, texel = (shadows or {}).get(light, (-1, 0.0))
        row[0] = (*light.position, KINDS[light.kind])
        row[1] = (*light.axis, layer)
        row[2] = (*light.radiance, 0.0)
        row[3] = (*light.cone, 0.0, texel)
    return rows


def _tuple(values: np.ndarray) -> tuple[float, float, float]:
    return tuple(map(float, values))
