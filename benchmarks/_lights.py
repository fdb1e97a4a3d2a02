"""The lights of the object pictures, for Cycles and as directional lights for sums on the CPU."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from addon.datasets.directions import spherical_to_unit
from addon.models.exr import read_picture

READS = 0.7
"""What a white diffuser that faces +z reads under a world."""

COUNT = 512
"""Directional lights that stand for a world."""

# (theta, phi) in degrees from +z and +x, and colour; of irradiance pi where the colour is white.
SUNS = {
    "sun": [((40, 30), (1.0, 1.0, 1.0))],
    "four suns": [
        ((30, 60), (0.50, 0.45, 0.40)),
        ((55, 170), (0.15, 0.30, 0.60)),
        ((62, 300), (0.55, 0.25, 0.12)),
        ((15, 250), (0.12, 0.18, 0.12)),
    ],
}
WORLD = "interior"
LIGHTS = (*SUNS, WORLD)


@dataclass(frozen=True)
class Lights:
    """Directional lights: directions (n, 3) towards them and irradiances over pi (n, 3)."""

    directions: NDArray[np.float64]
    irradiance: NDArray[np.float64]

    def turned(self, degrees: float) -> Lights:
        """Round +z, counter-clockwise."""
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        turn = np.array([(c, -s, 0), (s, c, 0), (0, 0, 1)])
        return Lights(self.directions @ turn.T, self.irradiance)


def lights(name: str, count: int = COUNT) -> Lights:
    """The suns of a name, or a world of Blender's as `count` lights."""
    if name in SUNS:
        angles, colours = zip(*SUNS[name], strict=True)
        return Lights(spherical_to_unit(*np.transpose(angles)), np.array(colours, float))
    return median_cut(world_radiance(name), count)


def light_scene(scene: bpy.types.Scene, name: str) -> None:
    """Give the lights to a scene."""
    if name in SUNS:
        add_suns(scene, lights(name))
        return
    world = bpy.data.worlds.new(name)
    if world.node_tree is None:  # before 5.0
        world.use_nodes = True
    tree = world.node_tree
    picture = tree.nodes.new("ShaderNodeTexEnvironment")
    picture.image = bpy.data.images.load(str(world_file(name)))
    background = tree.nodes["Background"]
    tree.links.new(picture.outputs["Color"], background.inputs["Color"])
    background.inputs["Strength"].default_value = exposure(read_picture(world_file(name)))
    scene.world = world


def add_suns(scene: bpy.types.Scene, suns: Lights) -> None:
    """Suns without size."""
    for direction, colour in zip(suns.directions, suns.irradiance, strict=True):
        sun = bpy.data.lights.new("Sun", "SUN")
        sun.energy, sun.angle, sun.color = pi, 0.0, colour
        item = bpy.data.objects.new("Sun", sun)
        item.rotation_mode = "QUATERNION"
        item.rotation_quaternion = Vector(direction).to_track_quat("Z", "Y")
        scene.collection.objects.link(item)


def world_file(name: str) -> Path:
    return Path(bpy.utils.system_resource("DATAFILES")) / "studiolights" / "world" / f"{name}.exr"


def world_radiance(name: str) -> NDArray[np.float64]:
    """A world's radiance (height, width, 3), bottom row first, as exposed in the pictures."""
    picture = read_picture(world_file(name)).astype(float)
    return picture * exposure(picture)


def exposure(picture: NDArray) -> float:
    """The strength of a world under which a white diffuser that faces +z reads READS, on average
    of its colours."""
    directions, angle = equirectangular(picture.shape[:2])
    cosine = np.maximum(directions[..., 2], 0.0)
    return float(READS * pi / np.mean(np.sum((cosine * angle)[..., None] * picture, axis=(0, 1))))


def equirectangular(shape: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions (height, width, 3) of Blender's environment textures and their solid angles."""
    rise = pi * ((np.arange(shape[0]) + 0.5) / shape[0] - 0.5)[:, None]
    turn = 2 * pi * (0.5 - (np.arange(shape[1]) + 0.5) / shape[1])[None]
    xyz = np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise) + 0 * turn
    angle = np.broadcast_to(np.cos(rise) * (pi / shape[0]) * (2 * pi / shape[1]), shape)
    return np.stack(xyz, -1), angle


def median_cut(radiance: NDArray[np.float64], count: int) -> Lights:
    """A world as directional lights of nearly equal energy (Debevec 2005).

    Regions are cut across their longer side where their energy is halved, the brightest first; a
    light stands at its region's centre of energy.
    """
    directions, angle = equirectangular(radiance.shape[:2])
    flux = radiance * angle[..., None]
    energy = flux.sum(-1)
    regions = [(energy.sum(), (slice(0, energy.shape[0]), slice(0, energy.shape[1])))]
    while len(regions) < count:
        regions.sort(key=lambda region: region[0])
        number = next(i for i in range(len(regions) - 1, -1, -1) if energy[regions[i][1]].size > 1)
        rows, columns = regions.pop(number)[1]
        part = energy[rows, columns]
        width = part.shape[1] * np.cos(pi * ((rows.start + rows.stop) / 2 / energy.shape[0] - 0.5))
        axis = int((width >= part.shape[0] and part.shape[1] > 1) or part.shape[0] == 1)
        sums = np.cumsum(part.sum(1 - axis))
        cut = min(int(np.searchsorted(sums, sums[-1] / 2)) + 1, part.shape[axis] - 1)
        start = (rows, columns)[axis].start
        for low, high in ((start, start + cut), (start + cut, start + part.shape[axis])):
            halves = (rows, slice(low, high)) if axis else (slice(low, high), columns)
            regions.append((energy[halves].sum(), halves))
    found = [
        (
            np.tensordot(energy[where], directions[where], 2),
            flux[where].sum((0, 1)),
        )
        for _, where in regions
    ]
    towards, colours = (np.array(part) for part in zip(*found, strict=True))
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    return Lights(towards, colours / pi)
