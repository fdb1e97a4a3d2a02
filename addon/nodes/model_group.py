"""The node group that evaluates a model's tables for one light.

    Nacre MODEL          UV, View, Light -> Value
      Nacre MODEL Texel  the core at one texel: view coefficients in, reduced light vector out

Texels are read with Closest and mixed by hand: EEVEE's other filters use mipmaps, which draw seams
where the texture coordinate jumps at a tile's edge.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..tables.tables import Tables
from .atlas import Atlas, make_atlas
from .graph import Graph, Wire


def make_model_group(name: str, tables: Tables) -> bpy.types.ShaderNodeTree:
    """A group with inputs UV, View and Light (unit vectors in the tangent frame), output Value.

    Value is linear and clamped at 0: radiance over that of a white diffuser lit head-on.
    """
    texels = tables.core.reshape(len(tables.core), -1, *tables.core.shape[3:])
    core, origins = make_atlas(f"{name} Core", texels)
    views, _ = make_atlas(f"{name} View", _view_maps(tables, origins)[None])
    size = tables.size
    lights, _ = make_atlas(f"{name} Light", tables.light.reshape(1, -1, size, size, 4))
    texel_group = _make_texel_group(f"{name} Texel", tables, core)

    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    for socket, kind in (("UV", "VECTOR"), ("View", "VECTOR"), ("Light", "VECTOR")):
        tree.interface.new_socket(socket, in_out="INPUT", socket_type=f"NodeSocket{kind.title()}")
    tree.interface.new_socket("Value", in_out="OUTPUT", socket_type="NodeSocketColor")
    for socket, tip in (
        ("UV", "Texture coordinates in patches; whole numbers repeat the material"),
        ("View", "Unit direction to the viewer: x tangent, y bitangent, z normal"),
        ("Light", "Unit direction to the light: x tangent, y bitangent, z normal"),
        ("Value", "Radiance over that of a white diffuser lit head-on by the same light"),
    ):
        tree.interface.items_tree[socket].description = tip
    g = Graph(tree)
    inputs = g.node("NodeGroupInput")
    uv, view, light = (g.wire(inputs, name) for name in ("UV", "View", "Light"))

    mixtures, quads = tables.view.shape[:2]
    place = _parabolic(g, view, tables.size, views)
    coefficients = [w for tile in range(mixtures * quads) for w in _fetch(g, views, place, tile)]
    blocks = []
    for tile in range(mixtures * quads, mixtures * quads + -(-mixtures // 2)):
        x0, y0, x1, y1 = _fetch(g, views, place, tile)
        blocks += [g.combine(x0, y0), g.combine(x1, y1)]

    reduced = _bilinear(g, uv, tables, core, texel_group, [*blocks[:mixtures], *coefficients])
    place = _parabolic(g, light, tables.size, lights)
    above = g.math("GREATER_THAN", g.separate(light)[2], 0.0)
    light_quads = tables.light.shape[1]
    channels = []
    for channel in range(3):
        value: Wire | float = 0.0
        for quad in range(light_quads):
            tile = quad + light_quads * min(channel, len(tables.light) - 1)
            rows = _fetch(g, lights, place, tile)
            for row, factor in zip(rows, reduced[4 * quad : 4 * quad + 4], strict=False):
                value = g.math("MULTIPLY_ADD", row, factor, value)
        channels.append(g.math("MAXIMUM", value * above, 0.0))
    g.node("NodeGroupOutput", g.combine(*channels))
    return tree


def _view_maps(tables: Tables, origins: np.ndarray) -> np.ndarray:
    """View coefficients, then the origins of each texel's clusters, two to an RGBA texel."""
    mixtures, _, size, _, _ = tables.view.shape
    places = np.zeros((-(-mixtures // 2) * 2, size, size, 2), np.float32)
    places[:mixtures] = origins[tables.index]
    pairs = places.reshape(-1, 2, size, size, 2).transpose(0, 2, 3, 1, 4)
    return np.concatenate(
        [tables.view.reshape(-1, size, size, 4), pairs.reshape(-1, size, size, 4)]
    )


def _make_texel_group(name: str, tables: Tables, core: Atlas) -> bpy.types.ShaderNodeTree:
    """The core at one texel with its view contracted: Place, Weight, blocks, coefficients -> R_l.

    Four of these share one tree. Sums run as chains of Multiply Add on scalars, each started where
    the last ended: Cycles keeps at most 255 live values, and inserts conversions between colours
    and vectors only after all nodes that wait for nothing, which would hold every texel at once.
    """
    _, rank_light, quads = tables.core.shape[:3]
    mixtures = tables.view.shape[0]
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")

    def socket(label: str, in_out: str, kind: str) -> None:
        tree.interface.new_socket(label, in_out=in_out, socket_type=f"NodeSocket{kind}")

    socket("Place", "INPUT", "Vector")
    socket("Weight", "INPUT", "Float")
    for k in range(mixtures):
        socket(f"Block {k}", "INPUT", "Vector")
    for i in range(mixtures * quads * 4):
        socket(f"Coefficient {i}", "INPUT", "Float")
    for r in range(rank_light):
        socket(f"Reduced {r}", "OUTPUT", "Float")

    g = Graph(tree)
    inputs = [Wire(g, output) for output in g.node("NodeGroupInput").outputs[:-1]]
    place, weight = inputs[:2]
    blocks, coefficients = inputs[2 : 2 + mixtures], inputs[2 + mixtures :]
    sums: list[Wire | float] = [0.0] * rank_light
    for k in range(mixtures):
        at = place + blocks[k]
        for q in range(quads):
            first = 4 * (k * quads + q)
            weighted = [c * weight for c in coefficients[first : first + 4]]
            for r in range(rank_light):
                for value, factor in zip(_fetch(g, core, at, r * quads + q), weighted, strict=True):
                    sums[r] = g.math("MULTIPLY_ADD", value, factor, sums[r])
    g.node("NodeGroupOutput", *sums)
    return tree


def _bilinear(
    g: Graph,
    uv: Wire,
    tables: Tables,
    core: Atlas,
    texel_group: bpy.types.ShaderNodeTree,
    operands: list[Wire],
) -> list[Wire]:
    """The reduced light vector at a point: four texels round it, mixed."""
    height, width = tables.core.shape[3:5]
    corners, weights = [], []
    for coordinate, size, scale in zip(g.separate(uv), (width, height), core.scale, strict=False):
        place = g.math("FRACT", coordinate) * float(size) - 0.5
        corner = g.math("FLOOR", place)
        along = place - corner
        texels = [g.math("FLOORED_MODULO", corner + float(step), float(size)) for step in (0, 1)]
        corners.append([(texel + 0.5) * (scale / size) for texel in texels])
        weights.append([g.operate("SUBTRACT", 1.0, along), along])
    reduced: list[Wire] = []
    for iy in (0, 1):
        for ix in (0, 1):
            tap = g.node(
                "ShaderNodeGroup",
                node_tree=texel_group,
            )
            values = [g.combine(corners[0][ix], corners[1][iy]), weights[0][ix] * weights[1][iy]]
            for operand, socket in zip([*values, *operands], tap.inputs, strict=True):
                g.connect(operand, socket)
            outputs = [Wire(g, output) for output in tap.outputs]
            reduced = [a + b for a, b in zip(reduced, outputs, strict=True)] if reduced else outputs
    return reduced


def _parabolic(g: Graph, direction: Wire, size: int, atlas: Atlas) -> Wire:
    """Where a direction's texel is in an atlas's first tile (tables.parabolic)."""
    x, y, z = g.separate(direction)
    reach = g.length(g.combine(x, y))
    divisor = g.math("MAXIMUM", g.math("MAXIMUM", z + 1.0, reach), 1e-6)
    centre, radius = size // 2 + 0.5, size // 2 - 1
    place = [
        g.math("MULTIPLY_ADD", p / divisor, radius * scale / size, centre * scale / size)
        for p, scale in zip((x, y), atlas.scale, strict=False)
    ]
    return g.combine(*place)


def _fetch(g: Graph, atlas: Atlas, place: Wire, tile: int) -> list[Wire]:
    """The four values of a texel: `place` within a tile plus the tile's own offset."""
    node = g.node(
        "ShaderNodeTexImage",
        place,
        image=atlas.image,
        interpolation="Closest",
        extension="EXTEND",
    )
    # The node's own mapping adds the offset: one node less than an addition, and no live value.
    node.texture_mapping.translation = atlas.offset(tile)
    colour = g.node("ShaderNodeSeparateColor", g.wire(node, "Color"))
    return [*(Wire(g, output) for output in colour.outputs), g.wire(node, "Alpha")]
