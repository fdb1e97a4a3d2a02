"""The two pictures Nacre makes of a material: the patch seen flat, and an object."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from ..nodes.material import MODEL_NODE, set_lights
from .engines import set_engine, use_scripts
from .stage import add_camera, add_mesh, add_sun, new_scene, unit

Direction = tuple[float, float]


@contextmanager
def flat_scene(
    material: bpy.types.Material, size: tuple[int, int], engine: str
) -> Iterator[FlatScene]:
    """The patch filling the picture, pixel for texel when sizes agree, for any light and view."""
    with new_scene(size) as scene:
        add_mesh(scene, "plane", material)
        add_camera(scene, (0.0, 0.0), 1.0)
        scene.render.pixel_aspect_x = max(1.0, size[1] / size[0])
        scene.render.pixel_aspect_y = max(1.0, size[0] / size[1])
        set_engine(scene, engine, 1)
        use_scripts(scene, material)
        scene.render.filter_size = 0.0  # one sample in the middle of each pixel
        scene.cycles.pixel_filter_type = "BOX"
        scene.cycles.filter_width = 0.01
        yield FlatScene(scene, material)


class FlatScene:
    """A flat patch whose view direction is given to the node group, not taken from the camera:
    the picture stays square to the patch, whichever way it is looked at."""

    def __init__(self, scene: bpy.types.Scene, material: bpy.types.Material) -> None:
        self.scene, self.material = scene, material
        socket = material.node_tree.nodes[MODEL_NODE].inputs["View"]
        for link in list(socket.links):
            material.node_tree.links.remove(link)
        self.view = socket

    def aim(self, light: Direction, view: Direction) -> None:
        """Light and view at (theta, phi) in degrees, in the patch's frame."""
        for item in [o for o in self.scene.objects if o.type == "LIGHT"]:
            bpy.data.objects.remove(item)
        add_sun(self.scene, light)
        set_lights(self.material, self.scene)
        self.view.default_value = unit(view)


@contextmanager
def object_scene(
    material: bpy.types.Material,
    mesh: str,
    size: tuple[int, int],
    engine: str,
    light: Direction,
    view: Direction,
    samples: int = 16,
) -> Iterator[bpy.types.Scene]:
    """An object under a sun; directions in degrees from the object's +z and +x."""
    with new_scene(size) as scene:
        add_mesh(scene, mesh, material)
        add_camera(scene, view, 2.3 * max(1.0, size[0] / size[1]))
        add_sun(scene, light)
        set_lights(material, scene)
        set_engine(scene, engine, samples)
        use_scripts(scene, material)
        scene.cycles.max_bounces = 0  # the material is measured: nothing bounces that it lacks
        yield scene
