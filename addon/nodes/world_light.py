"""The light of a Blender world as a picture of all directions, whatever its nodes are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..render.engines import render_pixels, set_engine
from .graph import Graph, Wire

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


def turning_node(world: bpy.types.World) -> bpy.types.ShaderNodeMapping | None:
    """The Mapping node that turns all of a world: the one between the world's directions and its
    only Environment Texture, when nothing else of it is set."""
    nodes = list(world.node_tree.nodes) if world.node_tree else []
    directional = [n for n in nodes if n.type.startswith("TEX_") and n.type != "TEX_COORD"]
    if len(directional) != 1 or directional[0].type != "TEX_ENVIRONMENT":
        return None
    if any(node.type in ("GROUP", "NEW_GEOMETRY") for node in nodes):
        return None
    links = directional[0].inputs["Vector"].links
    node = links[0].from_node if links else None
    if node is None or node.type != "MAPPING" or node.vector_type != "POINT":
        return None
    source = node.inputs["Vector"].links
    if not source or source[0].from_socket.identifier != "Generated":
        return None
    if any(node.inputs[name].is_linked for name in ("Location", "Rotation", "Scale")):
        return None
    plain = tuple(node.inputs["Location"].default_value) == (0.0, 0.0, 0.0)
    plain &= tuple(node.inputs["Scale"].default_value) == (1.0, 1.0, 1.0)
    # Directions may be used elsewhere too, to mix with the horizon say.
    users = [link for link in world.node_tree.links if link.from_node == source[0].from_node]
    return node if plain and len(users) == 1 else None


def rotation_of(mapping: bpy.types.ShaderNodeMapping | None) -> NDArray[np.float64]:
    """The matrix (3, 3) that takes directions in the scene to those of the picture."""
    if mapping is None:
        return np.eye(3)
    return np.array(mapping.inputs["Rotation"].default_value.to_matrix())


def turned(
    g: Graph, axes: Sequence[Wire], world: bpy.types.World, mapping: bpy.types.ShaderNodeMapping
) -> list[Wire]:
    """Directions in the scene as those of the picture, driven by the world's own rotation.

    They follow its keys; after an edit they follow once `follow_world` was called.
    """
    path = f'node_tree.nodes["{bpy.utils.escape_identifier(mapping.name)}"].inputs["Rotation"]'
    found = []
    for axis in axes:
        node = g.node("ShaderNodeMapping", axis, vector_type="POINT")
        for index in range(3):
            driver = node.inputs["Rotation"].driver_add("default_value", index).driver
            driver.type = "SUM"
            variable = driver.variables.new()
            variable.targets[0].id_type = "WORLD"
            variable.targets[0].id = world
            variable.targets[0].data_path = f"{path}.default_value[{index}]"
        found.append(g.wire(node))
    return found


def follow_world(world: bpy.types.World) -> None:
    """Let what is driven by a world's rotation follow an edit: Blender evaluates such drivers when
    the world is tagged, and an edit of its nodes tags only these."""
    world.update_tag()


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
