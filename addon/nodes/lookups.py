"""Reading tables in a shader tree: where a direction's texel is, and the four values there."""

from __future__ import annotations

import bpy

from .atlas import Atlas
from .graph import Graph, Operand, Wire


def parabolic(g: Graph, direction: Wire, size: int) -> tuple[Wire, Wire]:
    """Where a direction's texel is in a parabolic map of `size`, in parts of the map
    (tables.parabolic)."""
    centre, radius = (size // 2 + 0.5) / size, (size // 2 - 1) / size
    x, y = (g.math("MULTIPLY_ADD", p, radius, centre) for p in _projected(g, direction))
    return x, y


def place_between(g: Graph, direction: Wire, size: int) -> tuple[Wire, Wire]:
    """The same in texels, whose centres are whole numbers (tables.parabolic.place_of)."""
    centre, radius = float(size // 2), float(size // 2 - 1)
    x, y = (g.math("MULTIPLY_ADD", p, radius, centre) for p in _projected(g, direction))
    return x, y


def _projected(g: Graph, direction: Wire) -> tuple[Wire, Wire]:
    x, y, z = g.separate(direction)
    reach = g.length(g.combine(x, y))
    divisor = g.math("MAXIMUM", g.math("MAXIMUM", z + 1.0, reach), 1e-6)
    return x / divisor, y / divisor


def fetch_texel(g: Graph, image: bpy.types.Image, x: Operand, y: Operand) -> tuple[Wire, Wire]:
    """Colour and alpha of the texel at a texture coordinate, with Closest: EEVEE's other filters
    use mipmaps, which draw seams where the texture coordinate jumps at a tile's edge."""
    node = g.node(
        "ShaderNodeTexImage",
        g.combine(x, y),
        image=image,
        interpolation="Closest",
        extension="EXTEND",
    )
    # Set to what it is: only then EEVEE sees that the node's own mapping does nothing.
    node.texture_mapping.translation = (0.0, 0.0, 0.0)
    return g.wire(node, "Color"), g.wire(node, "Alpha")


class Lookup:
    """A place within the tiles of an atlas.

    Columns and rows of tiles are shifted to once each and as scalars: EEVEE keeps the constants of
    all nodes in 64 kB, and an image node's own mapping would take 96 bytes of that for each texel.
    """

    def __init__(self, g: Graph, atlas: Atlas, x: Wire, y: Wire) -> None:
        """`x` and `y` are texture coordinates in a block's first tile."""
        self.g, self.atlas = g, atlas
        self.columns: dict[int, Wire] = {0: x}
        self.rows: dict[int, Wire] = {0: y}

    def fetch(self, tile: int) -> list[Wire]:
        """The four values of the texel in a tile."""
        row, column = divmod(tile, self.atlas.columns)
        step_x, step_y, _ = self.atlas.scale
        colour, alpha = fetch_texel(
            self.g,
            self.atlas.image,
            self._shifted(self.columns, column, step_x),
            self._shifted(self.rows, row, step_y),
        )
        separated = self.g.node("ShaderNodeSeparateColor", colour)
        return [*(Wire(self.g, output) for output in separated.outputs), alpha]

    @property
    def x(self) -> Wire:
        """The texture coordinate across, in the block's first tile."""
        return self.columns[0]

    def after(self, value: Operand) -> Lookup:
        """The same place, read once a value is known.

        Cycles keeps at most 255 live values. Before 5.0 it converts places only when nothing else
        is left to do, so that it would hold those of all texels that wait for nothing.
        """
        if bpy.app.version >= (5, 0) or not isinstance(value, Wire):
            return self
        x = self.g.math("MULTIPLY_ADD", value, 1e-30, self.columns[0])
        return Lookup(self.g, self.atlas, x, self.rows[0])

    def _shifted(self, known: dict[int, Wire], number: int, step: float) -> Wire:
        if number not in known:
            known[number] = self.g.math("ADD", known[0], number * step)
        return known[number]


def look_up(
    g: Graph, atlas: Atlas, place: tuple[Wire, Wire], x: Operand = 0.0, y: Operand = 0.0
) -> Lookup:
    """A place in parts of a tile, in the block that begins at (x, y) of the atlas."""
    return Lookup(
        g,
        atlas,
        *(
            g.math("MULTIPLY_ADD", part, scale, origin)
            for part, scale, origin in zip(place, atlas.scale, (x, y), strict=False)
        ),
    )
