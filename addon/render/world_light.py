"""The light of a Blender world as a picture of all directions, whatever its nodes are."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..nodes.turning import turning_node
from .engines import render_pixels, set_engine

SIZE = (256, 128)
SAMPLES = 64
"""Of each pixel, so that a sun of one texel in 1024 has its energy to about a percent."""


@dataclass(frozen=True)
class WorldLight:
    """radiance (height, width, 3) as tables.world_picture maps it, and the Mapping node whose
    rotation was left out of it, None where there is none: a direction has the radiance of the
    picture where that node maps it to."""

    radiance: NDArray[np.float32]
    mapping: bpy.types.ShaderNodeMapping | None


def read_world(world: bpy.types.World | None) -> WorldLight:
    """Render a world in all directions with Cycles, in a scene of its own.

    Its light is what it sends on surfaces, not what a camera sees of it.
    """
    if world is None:
        return WorldLight(np.zeros((SIZE[1], SIZE[0], 3), np.float32), None)
    mapping = turning_node(world)
    with _unturned(world, mapping) as copy:
        return WorldLight(_panorama(copy), mapping)


@contextmanager
def _unturned(
    world: bpy.types.World, mapping: bpy.types.ShaderNodeMapping | None
) -> Iterator[bpy.types.World]:
    """A copy of a world without its rotation, whose rays are all those of diffuse surfaces."""
    copy = world.copy()
    try:
        if mapping is not None:
            copy.node_tree.nodes[mapping.name].inputs["Rotation"].default_value = (0.0, 0.0, 0.0)
        for node in copy.node_tree.nodes if copy.node_tree else ():
            if node.type == "LIGHT_PATH":
                for output in node.outputs:
                    for link in list(output.links):
                        socket = link.to_socket
                        copy.node_tree.links.remove(link)
                        if socket.type == "VALUE":
                            socket.default_value = float(output.name == "Is Diffuse Ray")
        yield copy
    finally:
        bpy.data.worlds.remove(copy)


def _panorama(world: bpy.types.World) -> NDArray[np.float32]:
    scene = bpy.data.scenes.new("Nacre World")
    camera = bpy.data.cameras.new("Nacre World")
    item = bpy.data.objects.new("Nacre World", camera)
    try:
        scene.world = world
        scene.collection.objects.link(item)
        scene.camera = item
        set_engine(scene, "cycles", SAMPLES)
        scene.render.resolution_x, scene.render.resolution_y = SIZE
        scene.render.resolution_percentage = 100
        scene.render.filter_size = 0.0
        scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 1.0
        camera.type = "PANO"
        settings = camera if hasattr(camera, "panorama_type") else camera.cycles
        settings.panorama_type = "EQUIRECTANGULAR"
        # The middle of the picture is along the camera's -z, its top along y.
        item.matrix_world = Matrix(((0, 0, -1), (-1, 0, 0), (0, 1, 0))).to_4x4()
        return render_pixels(scene)
    finally:
        bpy.data.scenes.remove(scene)
        bpy.data.objects.remove(item)
        bpy.data.cameras.remove(camera)
