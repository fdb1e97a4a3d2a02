"""The core at a point with its view contracted, in a shader tree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bpy

from .atlas import Atlas
from .graph import Graph, Operand, Wire
from .lookups import Lookup
from .packed_tensor import PackedTensor


@dataclass(frozen=True)
class Tap:
    """One of the four texels round a point: its place in a tile of the core, in texels from the
    tile's corner, and its bilinear weight."""

    x: Wire
    y: Wire
    weight: Wire


class Level:
    """A level of the core, chosen in the shader: as a size, and as a place beside the finest one
    (tables.levels.levels_beside)."""

    def __init__(self, g: Graph, number: Wire) -> None:
        self.g = g
        self.scale = g.math("POWER", 2.0, number * -1.0)

    def size(self, finest: int) -> Wire:
        return self.g.math("FLOOR", self.whole(self.scale * float(finest)))

    def origin(self, height: int, width: int) -> tuple[Wire, Wire]:
        row = self.g.math("MULTIPLY_ADD", self.scale, -2.0 * height, float(height))
        across = self.g.math("LESS_THAN", self.scale, 0.75) * float(width)
        return across, self.g.math("MAXIMUM", self.g.math("FLOOR", self.whole(row)), 0.0)

    def texel(self, finest: Wire, size: Wire) -> Wire:
        """The texel that has a texel of the finest level in it."""
        return self.g.math("MINIMUM", self.g.math("FLOOR", (finest + 0.5) * self.scale), size - 1.0)

    def whole(self, value: Wire) -> Wire:
        """A number that may be a whole one, safe from rounding down."""
        return value + 1e-3


def taps(
    g: Graph,
    uv: Wire,
    height: int,
    width: int,
    coordinates: bpy.types.Image | None = None,
    level: Level | None = None,
) -> list[Tap]:
    """The four texels round a point of a patch that repeats; with a map of coordinates, those that
    it has in their place (nodes.coordinates); of a level, or of the finest one."""
    finest = (width, height) if coordinates is None else tuple(coordinates.size)
    sizes: list[Operand] = [level.size(size) if level else float(size) for size in finest]
    texels, weights = [], []
    for coordinate, size, laid, own in zip(
        g.separate(uv), sizes, finest, (width, height), strict=False
    ):
        if laid != own:
            coordinate = coordinate * (own / laid)
        place = g.math("FRACT", coordinate) * size - 0.5
        corner = g.math("FLOOR", place)
        along = place - corner
        texels.append([g.math("FLOORED_MODULO", corner + float(step), size) for step in (0, 1)])
        weights.append([g.operate("SUBTRACT", 1.0, along), along])
    corners = [(ix, iy) for iy in (0, 1) for ix in (0, 1)]
    places = [(texels[0][ix], texels[1][iy]) for ix, iy in corners]
    if coordinates is not None:
        atlas = Atlas(coordinates, 1, 1, 1, 1)
        halved = level.scale if level else 1.0
        across, up = (g.operate("DIVIDE", 1.0 / size, halved) for size in finest)
        found = [Lookup(g, atlas, (x + 0.5) * across, (y + 0.5) * up) for x, y in places]
        places = [tuple(place.fetch(0)[:2]) for place in found]
        if level is not None:
            own = level.size(width), level.size(height)
            places = [
                tuple(level.texel(part, size) for part, size in zip(place, own, strict=True))
                for place in places
            ]
    if level is not None:
        left, low = level.origin(height, width)
        places = [(x + left, y + low) for x, y in places]
    return [
        Tap(x, y, weights[0][ix] * weights[1][iy])
        for (x, y), (ix, iy) in zip(places, corners, strict=True)
    ]


def contract_view(
    g: Graph,
    group: bpy.types.ShaderNodeTree,
    packed: PackedTensor,
    around: Sequence[Tap],
    operands: Sequence[Wire],
) -> list[Wire]:
    """The outputs of a texel group mixed over four texels; operands are as make_texel_group has
    them after the place and the weight."""
    across, up, _ = packed.core.scale
    height, width = packed.shapes.tile
    across, up = across / width, up / height
    total: list[Wire] = []
    for tap in around:
        x, y = (tap.x + 0.5) * across, (tap.y + 0.5) * up
        place = Lookup(g, packed.core, x, y).after(total[-1] if total else 0.0)
        node = g.node("ShaderNodeGroup", node_tree=group)
        for operand, socket in zip([place.x, y, tap.weight, *operands], node.inputs, strict=True):
            g.connect(operand, socket)
        outputs = [Wire(g, output) for output in node.outputs]
        total = [a + b for a, b in zip(total, outputs, strict=True)] if total else outputs
    return total


def make_texel_group(name: str, packed: PackedTensor) -> bpy.types.ShaderNodeTree:
    """The core at one texel: its place, a weight, where the light's cluster begins and those of the
    view's mixtures, and their coefficients -> R_light numbers; for each mixture, where light rows
    differ between them.

    Four of these share one tree. Sums run as chains of Multiply Add on scalars, each started where
    the last ended: Cycles keeps at most 255 live values, and inserts conversions between colours
    and vectors only after all nodes that wait for nothing, which would hold every texel at once.
    """
    shapes = packed.shapes
    rank, quads, mixtures = shapes.light_rank, shapes.view_quads, shapes.view_mixtures
    count = rank * (mixtures if shapes.views_apart else 1)
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")

    def socket(label: str, in_out: str, kind: str) -> None:
        tree.interface.new_socket(label, in_out=in_out, socket_type=f"NodeSocket{kind}")

    for label in ("X", "Y", "Weight", "Light Cluster"):
        socket(label, "INPUT", "Float")
    for k in range(mixtures):
        socket(f"View Cluster {k}", "INPUT", "Float")
    for i in range(mixtures * quads * 4):
        socket(f"Coefficient {i}", "INPUT", "Float")
    for r in range(count):
        socket(f"Reduced {r}", "OUTPUT", "Float")

    g = Graph(tree)
    inputs = [Wire(g, output) for output in g.node("NodeGroupInput").outputs[:-1]]
    x, y, weight, light_cluster = inputs[:4]
    view_clusters, coefficients = inputs[4 : 4 + mixtures], inputs[4 + mixtures :]
    sums: list[Wire | float] = [0.0] * count
    last: Wire | None = None
    for k in range(mixtures):
        core = Lookup(g, packed.core, x + light_cluster, y + view_clusters[k])
        base = rank * k if shapes.views_apart else 0
        for q in range(quads):
            first = 4 * (k * quads + q)
            weighted = [c * weight for c in coefficients[first : first + 4]]
            for r in range(rank):
                if r % 8 == 0:
                    here = core.after(last if last is not None else weighted[0])
                values = here.fetch(r * quads + q)
                for value, factor in zip(values, weighted, strict=True):
                    last = g.math("MULTIPLY_ADD", value, factor, sums[base + r])
                    sums[base + r] = last
    g.node("NodeGroupOutput", *sums)
    return tree
