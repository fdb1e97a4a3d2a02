"""The evaluation of a sparse model's tables, written into a shader tree (tables.sparse_tables).

One loop over the coefficients of a patch serves all lights: each is read once, with its texel and
its row of the view, and multiplied with each light's row. EEVEE keeps a repeat zone as a loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import log

import bpy

from ..models.domain import TO_RGB
from ..models.sparse.transform import MOST
from .atlas import Atlas
from .graph import Graph, Wire
from .lookups import fetch_texel, place_between
from .loops import repeat
from .packed_sparse import PackedSparse, SparseShapes


class Around:
    """The texel of direction maps below and left of a direction, and the weights of the four."""

    def __init__(self, g: Graph, direction: Wire, size: int) -> None:
        column, row = place_between(g, direction, size)
        corner = [
            g.math("MINIMUM", g.math("MAXIMUM", g.math("FLOOR", own), 0.0), size - 2.0)
            for own in (column, row)
        ]
        x, y = column - corner[0], row - corner[1]
        left, low = g.operate("SUBTRACT", 1.0, x), g.operate("SUBTRACT", 1.0, y)
        self.x, self.y = corner
        self.weights = g.combine(left * low, x * low, left * y)
        self.last = x * y

    def inside(self, g: Graph, atlas: Atlas, size: int) -> tuple[Wire, Wire]:
        """Where the texel is in an atlas' first tile."""
        across, up, _ = atlas.scale
        return (
            g.math("MULTIPLY_ADD", self.x, across / size, 0.5 * across / size),
            g.math("MULTIPLY_ADD", self.y, up / size, 0.5 * up / size),
        )


class SparseEvaluation:
    """What all lights share at a texel seen from a direction, and then any number of lights."""

    def __init__(
        self, g: Graph, packed: PackedSparse, texel: tuple[Wire, Wire], view: Wire
    ) -> None:
        """`texel` is a column and row of the patch, whole numbers; `view` a unit vector in the
        tangent frame."""
        self.packed = packed
        shapes = packed.shapes
        tall, wide = shapes.patch
        column, row = texel
        across = g.math("FLOOR", (column + 0.5) * (1.0 / wide))
        up = g.math("FLOOR", (row + 0.5) * (1.0 / tall))
        x = g.math("MULTIPLY_ADD", across, -float(wide), column)
        y = g.math("MULTIPLY_ADD", up, -float(tall), row)
        patches = shapes.patches[0] * shapes.patches[1]
        patch = g.math("MULTIPLY_ADD", up, float(shapes.patches[1]), across)
        self.patch = g.math("MULTIPLY_ADD", patch, 1.0 / patches, 0.5 / patches)
        within = g.math("MULTIPLY_ADD", y, float(wide), x)
        self.within = g.math("MULTIPLY_ADD", within, 1.0 / (tall * wide), 0.5 / (tall * wide))
        self.view = Around(g, view, shapes.size)
        self.view_place = self.view.inside(g, packed.view, shapes.size)

    def log_values(self, g: Graph, lights: Sequence[Wire]) -> list[Wire]:
        """Y, U, V of the logarithm of the colour under each light, a unit vector in the tangent
        frame."""
        shapes, packed = self.packed.shapes, self.packed
        around = [Around(g, light, shapes.size) for light in lights]
        places = [own.inside(g, packed.light, shapes.size) for own in around]
        total = shapes.ends[-1]

        def add_coefficient(g: Graph, index: Wire | int, state: list[Wire]) -> list[Wire]:
            along = g.math("MULTIPLY_ADD", index, 1.0 / total, 0.5 / total)
            colour, view_row = fetch_texel(g, packed.coefficients.image, along, self.patch)
            value, texel_row, light_row = g.separate(colour)
            texel, _ = fetch_texel(g, packed.texels.image, self.within, texel_row)
            seen = _row(g, packed.view, view_row, self.view_place, self.view)
            shared = value * g.separate(texel)[0] * seen
            before = [g.math("LESS_THAN", index, end - 0.5) for end in shapes.ends]
            yuv = g.combine(*before[:3])
            images = g.combine(*before[3:])
            sums = []
            for number, (place, own) in enumerate(zip(places, around, strict=True)):
                product = shared * _row(g, packed.light, light_row, place, own)
                sums += [
                    state[2 * number] + yuv * product,
                    state[2 * number + 1] + images * product,
                ]
            return sums

        sums = repeat(g, total, [(0.0, 0.0, 0.0)] * (2 * len(lights)), add_coefficient)
        return [
            _denormalised(g, *sums[2 * number : 2 * number + 2]) for number in range(len(lights))
        ]


class SparseAverage:
    """The average colour in place of all others, where neither loops nor scripts run."""

    def __init__(
        self, g: Graph, packed: PackedSparse, texel: tuple[Wire, Wire], view: Wire
    ) -> None:
        self.packed = packed

    def log_values(self, g: Graph, lights: Sequence[Wire]) -> list[Wire]:
        return [g.combine(*self.packed.shapes.average)] * len(lights)


def _row(g: Graph, atlas: Atlas, code: Wire, place: tuple[Wire, Wire], around: Around) -> Wire:
    """A row of a direction map at a direction: `code` is its row of tiles and, as a part of the
    width, where its column begins."""
    row = g.math("FLOOR", code)
    x = (code - row) + place[0]
    y = g.math("MULTIPLY_ADD", row, 1.0 / atlas.rows, place[1])
    colour, alpha = fetch_texel(g, atlas.image, x, y)
    return g.math("MULTIPLY_ADD", alpha, around.last, g.dot(colour, around.weights))


def _denormalised(g: Graph, parts: Wire, images: Wire) -> Wire:
    """Y, U, V from running sums: of Y, U and V, and after these of mean and deviation."""
    y, yu, yuv = g.separate(parts)
    with_mean, whole, _ = g.separate(images)
    mean, deviation = with_mean - yuv, whole - with_mean
    values = g.combine(y, yu - y, yuv - yu) * deviation
    return values + g.combine(mean, mean, mean)


def colour_of(g: Graph, values: Wire, offset: float, lowest: Wire | float, light: Wire) -> Wire:
    """The linear colour under a light of Y, U, V of its logarithm, clamped at 0 and faded where the
    light is lower than any that was measured."""
    bases = [g.dot(values, tuple(float(own) for own in row)) for row in TO_RGB]
    largest = MOST - log(offset)
    channels = [g.math("EXPONENT", g.math("MINIMUM", base, largest)) for base in bases]
    cosine = g.separate(light)[2]
    fade = g.wire(g.node("ShaderNodeMath", cosine, lowest, operation="DIVIDE", use_clamp=True))
    return g.combine(*(g.math("MAXIMUM", own - 1.0, 0.0) for own in channels)) * (fade * offset)


def nearest_texel(
    g: Graph, uv: Wire, shapes: SparseShapes, coordinates: bpy.types.Image | None = None
) -> tuple[Wire, Wire]:
    """Column and row of the texel at texture coordinates of a patch that repeats; with a map of
    coordinates, that which it has there (nodes.coordinates)."""
    own = (shapes.width, shapes.height)
    laid = own if coordinates is None else tuple(coordinates.size)
    found = []
    for coordinate, size, whole in zip(g.separate(uv), own, laid, strict=False):
        if whole != size:
            coordinate = coordinate * (size / whole)
        texel = g.math("FLOOR", g.math("FRACT", coordinate) * float(whole))
        found.append(g.math("MINIMUM", texel, whole - 1.0))
    if coordinates is None:
        return found[0], found[1]
    place = [
        g.math("MULTIPLY_ADD", texel, 1.0 / size, 0.5 / size)
        for texel, size in zip(found, laid, strict=True)
    ]
    colour, _ = fetch_texel(g, coordinates, *place)
    column, row, _ = g.separate(colour)
    return column, row
