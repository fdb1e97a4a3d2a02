"""The world's picture that a material is lit by, kept with it for tables that come later."""

from __future__ import annotations

import json
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..tables.any_tables import AnyTables
from ..tables.environment import EnvironmentTable, build_environment
from ..tables.light_lobes import light_lobes
from ..tables.sparse_tables import SparseTables
from .atlas import make_image

_NODE = "Nacre World"
_KEY = "nacre_world"


@dataclass(frozen=True)
class KeptWorld:
    """radiance (height, width, 3) as tables.world_picture maps it, the name of the world whose it
    is, and that of the node in it that turns it; "" where there is none."""

    radiance: NDArray[np.float32]
    world: str = ""
    mapping: str = ""


def keep_world(tree: bpy.types.ShaderNodeTree, kept: KeptWorld | None) -> None:
    """Keep a world with a material's nodes, in place of the last one; None for none."""
    node = tree.nodes.get(_NODE)
    if node is not None:
        before = node.image
        tree.nodes.remove(node)
        if before is not None:
            bpy.data.images.remove(before)
    if kept is None:
        tree.pop(_KEY, None)
        return
    pixels = np.ones((*kept.radiance.shape[:2], 4), np.float32)
    pixels[..., :3] = kept.radiance
    node = tree.nodes.new("ShaderNodeTexEnvironment")
    node.image = make_image(f"{_NODE} {kept.world}", pixels)
    node.name = node.label = _NODE
    node.location, node.hide = (0.0, -500.0), True
    tree[_KEY] = json.dumps([kept.world, kept.mapping])


def kept_world(tree: bpy.types.ShaderNodeTree) -> KeptWorld | None:
    """What `keep_world` kept."""
    node = tree.nodes.get(_NODE)
    if node is None or node.image is None or _KEY not in tree:
        return None
    width, height = node.image.size
    pixels = np.empty((height, width, 4), np.float32)
    node.image.pixels.foreach_get(pixels.ravel())
    return KeptWorld(pixels[..., :3], *json.loads(tree[_KEY]))


def environment_for(kept: KeptWorld | None, tables: AnyTables) -> EnvironmentTable | None:
    """The light basis of tables under a kept world; touches nothing of Blender, so that it can run
    on a thread. None for sparse tables, too, whose lights do not add up."""
    if kept is None or isinstance(tables, SparseTables):
        return None
    return build_environment(light_lobes(tables), kept.radiance)
