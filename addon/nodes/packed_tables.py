"""A model's tables as a node tree keeps them: images, and the shapes that say how to read them.

With these a tree can be written anew, for other lights, without the model at hand.
"""

from __future__ import annotations

import json
from dataclasses import asdict

import bpy

from ..tables.any_tables import AnyTables
from ..tables.sparse_tables import SparseTables
from .atlas import Atlas
from .packed_sparse import PackedSparse, pack_sparse, unpack_sparse
from .packed_tensor import PackedTensor, pack_tensor, unpack_tensor

HOLDER = "Table: "
_SHAPES = "nacre_shapes"

Packed = PackedTensor | PackedSparse
_KINDS: dict[str, type[Packed]] = {"tensor": PackedTensor, "sparse": PackedSparse}


def pack(name: str, tables: AnyTables) -> Packed:
    """Make the images of a model. Raises NacreError when its tables do not fit a texture."""
    if isinstance(tables, SparseTables):
        return pack_sparse(name, tables)
    return pack_tensor(name, tables)


def unpack(packed: Packed) -> AnyTables:
    """The tables that were packed."""
    if isinstance(packed, PackedSparse):
        return unpack_sparse(packed)
    return unpack_tensor(packed)


def store(tree: bpy.types.ShaderNodeTree, packed: Packed | None, place: str = "") -> None:
    """Keep what was packed with a node group, or none; images that it kept before are removed.

    Nodes without links hold the images: a property that points at them counts their users wrongly
    in Blender 4.5. `place` tells several that a group keeps from each other.
    """
    prefix = HOLDER + place
    kept = json.loads(tree.get(_SHAPES + place, "{}"))
    before = [tree.nodes.get(prefix + part.title()) for part in kept.get("grids", ())]
    images = [node.image for node in before if node is not None]
    for node in before:
        if node is not None:
            tree.nodes.remove(node)
    atlases = packed.atlases if packed is not None else {}
    for number, (part, atlas) in enumerate(atlases.items()):
        node = tree.nodes.new("ShaderNodeTexImage")
        node.image, node.interpolation, node.hide = atlas.image, "Closest", True
        node.name = node.label = prefix + part.title()
        node.location = (-400.0, -60.0 * number)
    held = [atlas.image for atlas in atlases.values()]
    for image in images:
        if image is not None and image not in held:
            bpy.data.images.remove(image)
    if packed is None:
        tree.pop(_SHAPES + place, None)
        return
    kind = next(name for name, own in _KINDS.items() if isinstance(packed, own))
    grids = {part: (own.across, own.up, own.columns, own.rows) for part, own in atlases.items()}
    described = {"kind": kind, "shapes": asdict(packed.shapes), "grids": grids}
    tree[_SHAPES + place] = json.dumps(described)


def stored(tree: bpy.types.ShaderNodeTree, place: str = "") -> Packed:
    """What `store` kept."""
    kept = json.loads(tree[_SHAPES + place])
    atlases = {
        part: Atlas(tree.nodes[HOLDER + place + part.title()].image, *grid)
        for part, grid in kept["grids"].items()
    }
    return _KINDS[kept.get("kind", "tensor")].restored(kept["shapes"], atlases)


def is_holder(node: bpy.types.Node) -> bool:
    """Whether a node is there for what it holds, not as a part of the shader."""
    return node.name.startswith(HOLDER)


def is_packed(tree: bpy.types.NodeTree | None, place: str = "") -> bool:
    """Whether a node group shows a model."""
    return tree is not None and _SHAPES + place in tree


def is_sparse(tree: bpy.types.NodeTree) -> bool:
    """Whether a node group shows a sparse model."""
    return is_packed(tree) and json.loads(tree[_SHAPES]).get("kind") == "sparse"
