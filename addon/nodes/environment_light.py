"""Light from all around, written into a shader tree.

An environment stands where a light does, with all clusters of lights in place of a few mixtures.
Its light vectors are read at the four grid points round the frame (tables.orientations), with
Closest and mixed by hand. Turning the world is turning the frame that goes in.
"""

from __future__ import annotations

from math import pi

from .evaluation import Evaluation
from .graph import Graph, Operand, Wire
from .loops import choose, repeat
from .packed_environment import PackedEnvironment


def environment_radiance(
    g: Graph,
    evaluation: Evaluation,
    environment: PackedEnvironment,
    tangent: Wire,
    bitangent: Wire,
    normal: Wire,
) -> list[Wire]:
    """Each channel of the radiance over the table's scale, clamped at 0."""
    places, weights = zip(*corners(g, tangent, bitangent, normal, environment.grid), strict=True)
    clusters = evaluation.packed.shapes.clusters[0]

    def add_cluster(g: Graph, index: Wire | int, state: list[Wire]) -> list[Wire]:
        across: Operand = 0.0 if isinstance(index, int) else index * (1.0 / clusters)
        reduced = evaluation.reduced or evaluation.contract(g, across)

        def add_corner(g: Graph, index: Wire | int, state: list[Wire]) -> list[Wire]:
            x, y, _ = g.separate(choose(g, index, places))
            zeros = [0.0] * environment.channels
            values = evaluation.rows(g, environment.atlas, (x, y), across, reduced, zeros)
            weight = choose(g, index, weights)
            return [
                g.math("MULTIPLY_ADD", value, weight, before)
                for value, before in zip(values, state, strict=True)
            ]

        return repeat(g, len(places), state, add_corner)

    total = repeat(g, clusters, [0.0] * environment.channels, add_cluster)
    return [g.math("MAXIMUM", value, 0.0) for value in total]


def corners(
    g: Graph, tangent: Wire, bitangent: Wire, normal: Wire, grid: int
) -> list[tuple[Wire, Wire]]:
    """Place in parts of a tile and weight of the grid points round a frame, unit vectors in the
    environment's world (tables.orientations.corners_of)."""
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
    across, down = 1.0 / grid**2, 1.0 / (8 * grid)

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
