"""Reading tables in a shader tree: where a direction's texel is, and the four values there."""

from __future__ import annotations

from .atlas import Atlas
from .graph import Graph, Wire


def parabolic(g: Graph, direction: Wire, size: int) -> tuple[Wire, Wire]:
    """Where a direction's texel is in a parabolic map of `size`, in parts of the map
    (tables.parabolic)."""
    x, y, z = g.separate(direction)
    reach = g.length(g.combine(x, y))
    divisor = g.math("MAXIMUM", g.math("MAXIMUM", z + 1.0, reach), 1e-6)
    centre, radius = (size // 2 + 0.5) / size, (size // 2 - 1) / size
    across, up = (g.math("MULTIPLY_ADD", p / divisor, radius, centre) for p in (x, y))
    return across, up


def within(g: Graph, atlas: Atlas, place: tuple[Wire, Wire]) -> Wire:
    """A place in parts of a tile as texture coordinates of an atlas's first tile."""
    return g.combine(*(p * scale for p, scale in zip(place, atlas.scale, strict=False)))


def fetch(g: Graph, atlas: Atlas, place: Wire, tile: int) -> list[Wire]:
    """The four values of a texel: `place` within a block's first tile, and the tile's number.

    Read with Closest: EEVEE's other filters use mipmaps, which draw seams where the texture
    coordinate jumps at a tile's edge.
    """
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
