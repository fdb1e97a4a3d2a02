"""The evaluation of a model's tables, written into a shader tree.

The core is contracted with the view first. Where one set of clusters serves all lights (N-SVD, CTA,
K-CTA) that is done once, and each light is then a product with its row of the basis; with clusters
of lights (MK-CTA) each light has a few small cores of its own.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from .graph import Graph, Operand, Wire
from .lookups import fetch, parabolic, within
from .loops import choose, repeat
from .packed_tables import PackedTables
from .texel_group import contract_view, taps


class Evaluation:
    """What all lights share at a point seen from a direction, and then any number of lights."""

    def __init__(
        self,
        g: Graph,
        packed: PackedTables,
        texel_group: bpy.types.ShaderNodeTree,
        uv: Wire,
        view: Wire,
    ) -> None:
        """`view` is a unit vector in the tangent frame."""
        self.packed, self.texel_group = packed, texel_group
        shapes = packed.shapes
        self.around = taps(g, uv, shapes.height, shapes.width)
        place = parabolic(g, view, shapes.size)
        self.view_place = within(g, packed.view, place)
        first = -(-shapes.light_mixtures // 4)  # in the index, lights come first
        self.view_clusters = self._clusters(g, place, shapes.view_mixtures, first, 1)
        self.reduced = self._contract(g, None) if shapes.reduced_once else None

    def value(self, g: Graph, light: Wire) -> list[Wire]:
        """Each channel for one light, a unit vector in the tangent frame, clamped at 0."""
        shapes = self.packed.shapes
        place = parabolic(g, light, shapes.size)
        at = within(g, self.packed.light, place)
        clusters = self._clusters(g, place, shapes.light_mixtures, 0, 0)

        def add_mixture(g: Graph, index: Wire | int, state: list[Wire]) -> list[Operand]:
            reduced = self.reduced or self._contract(g, choose(g, index, clusters))
            here = at
            if shapes.light_mixtures > 1:
                here = g.operate("ADD", at, g.combine(index * (1.0 / shapes.light_mixtures), 0.0))
            return self._rows(g, here, reduced, state)

        value = repeat(g, shapes.light_mixtures, [0.0] * shapes.channels, add_mixture)
        above = g.math("GREATER_THAN", g.separate(light)[2], 0.0)
        return [g.math("MAXIMUM", g.math("MULTIPLY", channel, above), 0.0) for channel in value]

    def _clusters(
        self, g: Graph, place: tuple[Wire, Wire], mixtures: int, tile: int, axis: int
    ) -> list[Operand]:
        """Where the clusters of a direction begin, as parts of the width or height of an atlas."""
        if self.packed.shapes.clusters[axis] == 1:
            return [0.0] * mixtures
        at = within(g, self.packed.index, place)
        found: list[Operand] = []
        while len(found) < mixtures:
            found += fetch(g, self.packed.index, at, tile + len(found) // 4)
        return found[:mixtures]

    def _contract(self, g: Graph, light_cluster: Operand | None) -> list[Wire]:
        """Reduced light vectors for one of a light's clusters, or for all lights."""
        shapes = self.packed.shapes
        across = 0.0 if light_cluster is None else light_cluster
        at = self.view_place
        if shapes.view_owners > 1:
            at = g.operate("ADD", at, g.combine(across, 0.0))
        coefficients = [
            value
            for tile in range(shapes.view_mixtures * shapes.view_quads)
            for value in fetch(g, self.packed.view, at, tile)
        ]
        blocks = [g.combine(across, cluster) for cluster in self.view_clusters]
        return contract_view(
            g, self.texel_group, self.packed, self.around, [*blocks, *coefficients]
        )

    def _rows(
        self, g: Graph, at: Wire, reduced: Sequence[Wire], state: Sequence[Operand]
    ) -> list[Operand]:
        """The sums of `state` and the products of reduced vectors with rows of the light basis."""
        shapes = self.packed.shapes
        sums = list(state)
        for number, cluster in enumerate(self.view_clusters if shapes.views_apart else [None]):
            vector = reduced[number * shapes.light_rank : (number + 1) * shapes.light_rank]
            here = at
            if cluster is not None:
                # Cycles keeps at most 255 live values, and reads textures as soon as it can: let
                # these wait for the numbers they are multiplied with.
                wait = g.math("MULTIPLY", vector[0], 1e-30)
                here = g.operate("ADD", at, g.combine(wait, cluster))
            for channel in range(shapes.channels):
                for quad in range(shapes.light_quads):
                    rows = fetch(g, self.packed.light, here, channel * shapes.light_quads + quad)
                    for row, factor in zip(rows, vector[4 * quad :], strict=False):
                        sums[channel] = g.math("MULTIPLY_ADD", row, factor, sums[channel])
        return sums
