"""The map of coordinates that lays a material anew, as a node group keeps it (coordinate_map)."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from .atlas import make_image
from .packed_tables import HOLDER

_NODE = f"{HOLDER}Coordinates"


def make_coordinates(name: str, coordinates: NDArray[np.integer]) -> bpy.types.Image:
    """An image of coordinates (H, W, 2), texel row y and column x, as (x, y, 0, 1)."""
    pixels = np.zeros((*coordinates.shape[:2], 4), np.float32)
    pixels[..., 0], pixels[..., 1], pixels[..., 3] = coordinates[..., 1], coordinates[..., 0], 1.0
    return make_image(name, pixels)


def read_coordinates(image: bpy.types.Image) -> NDArray[np.uint16]:
    """What `make_coordinates` was given."""
    width, height = image.size
    pixels = np.empty(height * width * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, 4)[..., 1::-1].astype(np.uint16)


def store_coordinates(tree: bpy.types.ShaderNodeTree, image: bpy.types.Image | None) -> None:
    """Keep a map with a node group, or none."""
    node = tree.nodes.get(_NODE)
    if node is not None:
        tree.nodes.remove(node)
    if image is not None:
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image, node.interpolation, node.hide = image, "Closest", True
        node.name = node.label = _NODE
        node.location = (-400.0, -360.0)


def stored_coordinates(tree: bpy.types.ShaderNodeTree) -> bpy.types.Image | None:
    """What `store_coordinates` kept."""
    node = tree.nodes.get(_NODE)
    return None if node is None else node.image
