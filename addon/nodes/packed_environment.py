"""A world's light as a model's node group keeps it: an image, and how to read it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from zlib import crc32

import bpy
import numpy as np
from numpy.typing import NDArray

from ..tables.environment import EnvironmentTable
from .atlas import Atlas, cut_out, lay_out, make_image
from .packed_tables import HOLDER
from .packed_tensor import Shapes

_KEY = "nacre_environment"
_NODE = f"{HOLDER}Environment"


@dataclass(frozen=True)
class PackedEnvironment:
    """An environment table as an image, whose values are to be multiplied with `scale`.

    Clusters of lights go across and those of views up, as in the model's own images. `world` names
    the world whose light it is and `mapping` the node in it that turns it; "" where there is none.
    `stamp` is that of the table, to tell when the image was filled with another one.
    """

    atlas: Atlas
    grid: int
    channels: int
    scale: float
    world: str = ""
    mapping: str = ""
    stamp: int = 0


def pack_environment(
    name: str, table: EnvironmentTable, world: str = "", mapping: str = ""
) -> PackedEnvironment:
    """Make the image of an environment. Raises NacreError when it does not fit a texture."""
    blocks = _blocks(table)
    pixels, columns, rows = lay_out(name, blocks)
    image = make_image(name, pixels)
    image.use_half_precision = True  # as the table is
    atlas = Atlas(image, *blocks.shape[:2], columns, rows)
    return PackedEnvironment(
        atlas, table.grid, table.vectors.shape[1], table.scale, world, mapping, stamp_of(table)
    )


def stamp_of(table: EnvironmentTable) -> int:
    """A number that differs from one table to the next."""
    return crc32(np.float64(table.scale).tobytes(), crc32(table.vectors.tobytes()))


def unpack_environment(packed: PackedEnvironment, shapes: Shapes) -> EnvironmentTable:
    """The table that was packed, for a model of these shapes."""
    grid = packed.grid
    tiles = packed.channels * shapes.light_quads
    blocks = cut_out(packed.atlas, tiles, 8 * grid, grid * grid)
    vectors = blocks.reshape(
        *blocks.shape[:2], packed.channels, shapes.light_quads, 2, 4, grid, grid, grid, 4
    )
    vectors = np.moveaxis(vectors, 0, 2).astype(np.float16)
    return EnvironmentTable(vectors, packed.scale, shapes.light_rank)


def refill_environment(packed: PackedEnvironment, table: EnvironmentTable) -> bool:
    """Put another table of the same shape into the image, so that nothing is compiled anew; False
    for a table of another shape."""
    image = packed.atlas.image
    pixels, _, _ = lay_out(image.name, _blocks(table))
    if (image.size[1], image.size[0]) != pixels.shape[:2] or packed.grid != table.grid:
        return False
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    image.update()
    return True


def store_environment(tree: bpy.types.ShaderNodeTree, packed: PackedEnvironment | None) -> None:
    """Keep a world's light with a node group, or none; the image that it kept before is removed."""
    node = tree.nodes.get(_NODE)
    before = None if node is None else node.image
    if node is not None:
        tree.nodes.remove(node)
    if packed is None:
        tree.pop(_KEY, None)
    else:
        atlas = packed.atlas
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image, node.interpolation, node.hide = atlas.image, "Closest", True
        node.name = node.label = _NODE
        node.location = (-400.0, -300.0)
        tree[_KEY] = json.dumps(
            {
                "atlas": [atlas.across, atlas.up, atlas.columns, atlas.rows],
                "grid": packed.grid,
                "channels": packed.channels,
                "scale": packed.scale,
                "world": packed.world,
                "mapping": packed.mapping,
                "stamp": packed.stamp,
            }
        )
    if before is not None and (packed is None or before != packed.atlas.image):
        bpy.data.images.remove(before)


def stored_environment(tree: bpy.types.ShaderNodeTree) -> PackedEnvironment | None:
    """What `store_environment` kept."""
    node = tree.nodes.get(_NODE)
    if node is None or node.image is None or _KEY not in tree:
        return None
    kept = json.loads(tree[_KEY])
    return PackedEnvironment(**{**kept, "atlas": Atlas(node.image, *kept["atlas"])})


def _blocks(table: EnvironmentTable) -> NDArray[np.float32]:
    """(C_light, owners, channels * quads, 8 G, G * G, 4)."""
    owners, _, clusters, _ = table.vectors.shape[:4]
    grid = table.grid
    vectors = np.moveaxis(table.vectors, 2, 0)
    return vectors.reshape(clusters, owners, -1, 8 * grid, grid * grid, 4).astype(np.float32)
