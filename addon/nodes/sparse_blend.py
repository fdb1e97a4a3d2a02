"""A second sparse model that a node group mixes with its own, and the input that says how much."""

from __future__ import annotations

import bpy

from .packed_sparse import PackedSparse
from .packed_tables import Packed, is_packed, store, stored

MIX = "Mix"
_PLACE = "Blended "
_TIP = (
    "How much of the second model is shown: 0 none, 1 that alone; a mask may be linked here. "
    "Logarithms are mixed, so that half-way between white and black is not half as bright "
    "(SparseBTF, Section 3.5 Eq. 7)"
)


def store_blended(tree: bpy.types.ShaderNodeTree, packed: PackedSparse | None) -> None:
    """Keep a second model with a node group, and the input Mix; or neither."""
    store(tree, packed, _PLACE)
    socket = tree.interface.items_tree.get(MIX)
    if packed is None and socket is not None:
        tree.interface.remove(socket)
    if packed is not None and socket is None:
        socket = tree.interface.new_socket(MIX, in_out="INPUT", socket_type="NodeSocketFloat")
        socket.subtype, socket.description = "FACTOR", _TIP
        socket.min_value, socket.max_value, socket.default_value = 0.0, 1.0, 0.5


def blended_with(tree: bpy.types.ShaderNodeTree) -> PackedSparse | None:
    """What `store_blended` kept."""
    return stored(tree, _PLACE) if is_packed(tree, _PLACE) else None


def goes_with(packed: Packed, other: PackedSparse | None) -> bool:
    """Whether the logarithms of two models can be mixed; None goes with all."""
    if other is None:
        return True
    return isinstance(packed, PackedSparse) and packed.shapes.offset == other.shapes.offset
