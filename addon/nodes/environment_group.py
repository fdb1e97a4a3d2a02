"""The node group that lights a model from all around.

    Nacre MODEL Environment           Normal, Tangent, Bitangent, Strength, Reduced -> Value
      Nacre MODEL Environment Texel   the light vector of one orientation times the reduced vector

The frame is found among the orientations as tables.orientations does it, and its four grid points
are read with Closest. Turning the world is turning the frame that goes in.
"""

from __future__ import annotations

from math import pi, sqrt

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import NacreError
from ..tables.environment import EnvironmentTable
from .atlas import LARGEST, Atlas, make_image
from .graph import Graph, Wire

FRAME = ("Tangent", "Bitangent", "Normal")


def make_environment_group(name: str, table: EnvironmentTable) -> bpy.types.ShaderNodeTree:
    """A group for models whose lights are not clustered (one C_light, one owner).

    Inputs are the frame's unit vectors in the world of the environment, what the light's strength
    is times the table's scale, and the core contracted with the view, R_light numbers. Value is
    linear radiance clamped at 0. Raises NacreError when the table does not fit a texture.
    """
    owners, channels, clusters, light_quads = table.vectors.shape[:4]
    if owners * clusters != 1:
        raise ValueError(f"table: expected one cluster, got {owners} owners x {clusters} clusters")
    atlas = _make_atlas(f"{name} Environment", table)
    texel_group = _make_texel_group(f"{name} Environment Texel", table, atlas)

    tree = bpy.data.node_groups.new(f"{name} Environment", "ShaderNodeTree")
    for label in FRAME:
        _socket(tree, label, "Vector", "Unit vector in the world of the environment")
    _socket(tree, "Strength", "Float", "Strength of the environment times the table's scale")
    tree.interface.items_tree["Strength"].default_value = table.scale
    for r in range(table.rank):
        _socket(tree, f"Reduced {r}", "Float", "The core contracted with the view")
    _socket(tree, "Value", "Color", "Radiance", "OUTPUT")

    g = Graph(tree)
    tangent, bitangent, normal, strength, *reduced = (
        Wire(g, output) for output in g.node("NodeGroupInput").outputs[:-1]
    )
    total: list[Wire] = []
    for place, weight in _corners(g, tangent, bitangent, normal, table.grid, atlas):
        tap = g.node("ShaderNodeGroup", node_tree=texel_group)
        for operand, socket in zip((place, weight, *reduced), tap.inputs, strict=True):
            g.connect(operand, socket)
        outputs = [Wire(g, output) for output in tap.outputs]
        total = [a + b for a, b in zip(total, outputs, strict=True)] if total else outputs
    values = [g.math("MAXIMUM", value, 0.0) for value in total]
    g.node("NodeGroupOutput", g.combine(*(values * 3)[:3]) * strength)
    return tree


def fill_environment(tree: bpy.types.ShaderNodeTree, table: EnvironmentTable) -> None:
    """Put another environment into a group made before: its image alone changes, so nothing is
    compiled. The Strength that comes with it is the table's scale."""
    image = bpy.data.images[tree.name]
    pixels = _pixels(table)
    if (image.size[1], image.size[0]) != pixels.shape[:2]:
        raise ValueError(f"table: expected one of the group's own model and grid, got {table.grid}")
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    image.update()
    tree.interface.items_tree["Strength"].default_value = table.scale


def _columns(table: EnvironmentTable) -> int:
    """How many quads stand side by side in the image, which is as square as it can be."""
    tiles = int(np.prod(table.vectors.shape[:4]))
    return max(1, min(tiles, round(sqrt(tiles * 8 / table.grid))))


def _pixels(table: EnvironmentTable) -> NDArray[np.float32]:
    """Quads as tiles of 8 G rows and G * G columns."""
    grid, columns = table.grid, _columns(table)
    tiles = table.vectors.astype(np.float32).reshape(-1, 8 * grid, grid * grid, 4)
    missing = -len(tiles) % columns
    tiles = np.pad(tiles, [(0, missing), (0, 0), (0, 0), (0, 0)])
    rows = tiles.reshape(-1, columns, *tiles.shape[1:]).transpose(0, 2, 1, 3, 4)
    return np.ascontiguousarray(rows.reshape(-1, columns * grid * grid, 4))


def _make_atlas(name: str, table: EnvironmentTable) -> Atlas:
    pixels = _pixels(table)
    if max(pixels.shape) > LARGEST:
        raise NacreError(
            f"{name}: needs a texture of {pixels.shape[1]} x {pixels.shape[0]} texels and {LARGEST}"
            " is the limit; compress with a lower rank of the light"
        )
    columns = _columns(table)
    image = make_image(name, pixels)
    image.use_half_precision = True  # as the table is
    return Atlas(image, columns, len(pixels) // (8 * table.grid), columns)


def _corners(
    g: Graph, tangent: Wire, bitangent: Wire, normal: Wire, grid: int, atlas: Atlas
) -> list[tuple[Wire, Wire]]:
    """Place and weight of the grid points round a frame (tables.orientations.corners_of)."""
    left = g.math("LESS_THAN", g.dot(g.cross(tangent, bitangent), normal), 0.0)
    bitangent = bitangent * g.math("MULTIPLY_ADD", left, -2.0, 1.0)
    tx, by, nz = g.separate(tangent)[0], g.separate(bitangent)[1], g.separate(normal)[2]
    # The half turn that leaves least to turn; the last one that is better wins.
    best = tx + by + nz
    turn: Wire | None = None
    for number, (one, two, three) in enumerate(((tx, by, nz), (by, tx, nz), (nz, tx, by)), 1):
        trace = one - two - three
        better = g.math("GREATER_THAN", trace, best) * float(number)
        turn = g.math("MAXIMUM", turn, better) if turn else better
        best = g.math("MAXIMUM", trace, best)
    x_sign = g.math("MULTIPLY_ADD", g.math("GREATER_THAN", turn, 1.5), -2.0, 1.0)
    y_sign = g.math("MULTIPLY_ADD", g.math("MODULO", turn, 2.0), -2.0, 1.0)
    signs = g.combine(x_sign, y_sign, x_sign * y_sign)
    _, ty, tz = g.separate(g.operate("MULTIPLY", tangent, signs))
    bx, _, bz = g.separate(g.operate("MULTIPLY", bitangent, signs))
    nx, ny, _ = g.separate(g.operate("MULTIPLY", normal, signs))
    # Four times the quaternion's w^2, kept from 0 for frames that are none.
    square = g.math("MAXIMUM", best + 1.0, 1e-3)
    middle = grid // 2
    coordinates = g.combine(
        *(g.math("ARCTANGENT", part / square) for part in (bz - ny, nx - tz, ty - bx))
    )
    away = g.operate("ABSOLUTE", coordinates) * (4.0 / pi * middle)
    away = g.operate("MINIMUM", away, (middle - 1e-4,) * 3)
    corner = g.operate("FLOOR", away)
    fractions = g.separate(away - corner)
    x, y, z = fractions
    low, high = g.math("MINIMUM", x, y), g.math("MAXIMUM", x, y)
    most, least = g.math("MAXIMUM", high, z), g.math("MINIMUM", low, z)
    second = g.math("MAXIMUM", low, g.math("MINIMUM", high, z))
    outward = g.operate("SIGN", coordinates)
    # Rows are y of the half turn's cube, columns z and x.
    row = g.math("MULTIPLY_ADD", left, 4.0, turn) * float(grid) + (middle + 0.5)
    across, down = atlas.scale[0] / grid**2, atlas.scale[1] / (8 * grid)

    def place(steps: tuple[Wire, Wire, Wire] | float) -> Wire:
        step = steps if isinstance(steps, float) else g.combine(*steps)
        point = g.operate("MULTIPLY", corner + step, outward)
        column = g.dot(point, (across, 0.0, grid * across))
        return g.combine(
            column + (middle + middle * grid + 0.5) * across,
            (g.separate(point)[1] + row) * down,
        )

    largest = tuple(g.math("COMPARE", f, most, 0.0) for f in fractions)
    larger = tuple(g.math("GREATER_THAN", f, least) for f in fractions)
    return [
        (place(0.0), g.operate("SUBTRACT", 1.0, most)),
        (place(largest), most - second),
        (place(larger), second - least),
        (place(1.0), least),
    ]


def _make_texel_group(name: str, table: EnvironmentTable, atlas: Atlas) -> bpy.types.ShaderNodeTree:
    """One orientation: Place, Weight, Reduced -> the weighted radiance of each channel."""
    channels, light_quads = table.vectors.shape[1], table.vectors.shape[3]
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    _socket(tree, "Place", "Vector", "Where the first quad of an orientation is")
    _socket(tree, "Weight", "Float", "Of this orientation")
    for r in range(table.rank):
        _socket(tree, f"Reduced {r}", "Float", "The core contracted with the view")
    for channel in range(channels):
        _socket(tree, f"Channel {channel}", "Float", "Weighted radiance", "OUTPUT")
    g = Graph(tree)
    place, weight, *reduced = (Wire(g, o) for o in g.node("NodeGroupInput").outputs[:-1])
    values = []
    for channel in range(channels):
        value: Wire | float = 0.0
        for quad in range(light_quads):
            node = g.node(
                "ShaderNodeTexImage",
                place,
                image=atlas.image,
                interpolation="Closest",
                extension="EXTEND",
            )
            node.texture_mapping.translation = atlas.offset(channel * light_quads + quad)
            colour = g.node("ShaderNodeSeparateColor", g.wire(node, "Color"))
            texel = [*(Wire(g, output) for output in colour.outputs), g.wire(node, "Alpha")]
            for part, factor in zip(texel, reduced[4 * quad : 4 * quad + 4], strict=False):
                value = g.math("MULTIPLY_ADD", part, factor, value)
        values.append(value * weight)
    g.node("NodeGroupOutput", *values)
    return tree


def _socket(
    tree: bpy.types.ShaderNodeTree, label: str, kind: str, tip: str, in_out: str = "INPUT"
) -> None:
    socket = tree.interface.new_socket(label, in_out=in_out, socket_type=f"NodeSocket{kind}")
    socket.description = tip
