"""The evaluation of a model's tables, written into a shader tree.

The core is contracted with the view first. Where one set of clusters serves all lights (N-SVD, CTA,
K-CTA) that is done once, and each light is then a product with its row of the basis; with clusters
of lights (MK-CTA) each light has a few small cores of its own.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from .atlas import Atlas
from .footprint import level_group
from .graph import Graph, Operand, Wire
from .lookups import look_up, parabolic
from .loops import choose, repeat
from .packed_tensor import PackedTensor, Shapes
from .texel_group import Level, contract_view, taps

FINER = 1.0
"""Levels below the one whose texel is as large as a pixel's longer side: EEVEE and Cycles take many
samples of a pixel, which do the rest (benchmarks.distance)."""


class Evaluation:
    """What all lights share at a point seen from a direction, and then any number of lights."""

    def __init__(
        self,
        g: Graph,
        packed: PackedTensor,
        texel_group: bpy.types.ShaderNodeTree,
        uv: Wire,
        view: Wire,
        coordinates: bpy.types.Image | None = None,
    ) -> None:
        """`view` is a unit vector in the tangent frame, `coordinates` a map that lays the material
        anew."""
        self.packed, self.texel_group = packed, texel_group
        shapes = packed.shapes
        level = choose_level(g, uv, shapes) if shapes.levels else None
        self.around = taps(g, uv, shapes.height, shapes.width, coordinates, level)
        place = parabolic(g, view, shapes.size)
        self.view_place = place
        first = -(-shapes.light_mixtures // 4)  # in the index, lights come first
        self.view_clusters = self._clusters(g, place, shapes.view_mixtures, first, 1)
        self.reduced = self.contract(g, None) if shapes.reduced_once else None

    def value(self, g: Graph, light: Wire) -> list[Wire]:
        """Each channel for one light, a unit vector in the tangent frame, clamped at 0."""
        shapes = self.packed.shapes
        place = parabolic(g, light, shapes.size)
        clusters = self._clusters(g, place, shapes.light_mixtures, 0, 0)

        def add_mixture(g: Graph, index: Wire | int, state: list[Wire]) -> list[Operand]:
            reduced = self.reduced or self.contract(g, choose(g, index, clusters))
            return self.rows(
                g, self.packed.light, place, index * (1.0 / shapes.light_mixtures), reduced, state
            )

        value = repeat(g, shapes.light_mixtures, [0.0] * shapes.channels, add_mixture)
        above = g.math("GREATER_THAN", g.separate(light)[2], 0.0)
        return [g.math("MAXIMUM", g.math("MULTIPLY", channel, above), 0.0) for channel in value]

    def _clusters(
        self, g: Graph, place: tuple[Wire, Wire], mixtures: int, tile: int, axis: int
    ) -> list[Operand]:
        """Where the clusters of a direction begin, as parts of the width or height of an atlas."""
        if self.packed.shapes.clusters[axis] == 1:
            return [0.0] * mixtures
        index = look_up(g, self.packed.index, place)
        found: list[Operand] = []
        while len(found) < mixtures:
            found += index.fetch(tile + len(found) // 4)
        return found[:mixtures]

    def contract(self, g: Graph, light_cluster: Operand | None) -> list[Wire]:
        """Reduced light vectors for one of a light's clusters, or for all lights."""
        shapes = self.packed.shapes
        across = 0.0 if light_cluster is None else light_cluster
        own = across if shapes.view_owners > 1 else 0.0
        rows = look_up(g, self.packed.view, self.view_place, x=own)
        tiles = range(shapes.view_mixtures * shapes.view_quads)
        coefficients = [value for tile in tiles for value in rows.fetch(tile)]
        operands = [across, *self.view_clusters, *coefficients]
        return contract_view(g, self.texel_group, self.packed, self.around, operands)

    def rows(
        self,
        g: Graph,
        atlas: Atlas,
        place: tuple[Wire, Wire],
        across: Operand,
        reduced: Sequence[Wire],
        state: Sequence[Operand],
    ) -> list[Operand]:
        """The sums of `state`, one a channel, and the products of reduced vectors with rows of the
        light basis in an atlas."""
        shapes = self.packed.shapes
        sums = list(state)
        for number, cluster in enumerate(self.view_clusters if shapes.views_apart else [None]):
            vector = reduced[number * shapes.light_rank : (number + 1) * shapes.light_rank]
            basis = look_up(g, atlas, place, across, 0.0 if cluster is None else cluster)
            for channel in range(len(sums)):
                basis = basis.after(sums[channel - 1] if channel else vector[0])
                for quad in range(shapes.light_quads):
                    rows = basis.fetch(channel * shapes.light_quads + quad)
                    for row, factor in zip(rows, vector[4 * quad :], strict=False):
                        sums[channel] = g.math("MULTIPLY_ADD", row, factor, sums[channel])
        return sums


def choose_level(g: Graph, uv: Wire, shapes: Shapes, finer: float = FINER) -> Level:
    """The level of the core nearest to `finer` levels below that of a pixel's footprint."""
    texels = g.operate("MULTIPLY", uv, (float(shapes.width), float(shapes.height), 0.0))
    level = g.wire(g.node("ShaderNodeGroup", texels, node_tree=level_group()))
    whole = g.math("FLOOR", level + (0.5 - finer))
    return Level(g, g.math("MINIMUM", g.math("MAXIMUM", whole, 0.0), float(shapes.levels)))
