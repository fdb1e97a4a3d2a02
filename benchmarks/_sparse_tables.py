"""Sparse tables of random numbers: rows that change slowly with the direction, as measured ones."""

from __future__ import annotations

import numpy as np

from addon.tables.parabolic import texel_directions
from addon.tables.sparse_tables import Part, Product, SparseTables


def random_sparse_tables(
    counts: tuple[int, int, int] = (24, 5, 3),
    rows: tuple[int, int, int] = (11, 9, 14),
    patch: tuple[int, int] = (4, 5),
    texels: tuple[int, int] = (12, 20),
    size: int = 64,
    seed: int = 0,
) -> SparseTables:
    """`counts` of the coefficients of a patch in Y, U and V, at most, which use `rows` of texels,
    light and view; some patches have fewer, and one has none in U. Logarithms stay above 0."""
    random = np.random.default_rng(seed)
    directions = texel_directions(size)
    x, y, z = np.moveaxis(directions, -1, 0)
    waves = np.stack([np.ones_like(x), x, y, z, x * y, x * x - y * y, x * z, y * z])

    def maps(*shape: int) -> np.ndarray:
        found = random.normal(0, 0.3, (*shape, len(waves))) @ waves.reshape(len(waves), -1)
        return found.reshape(*shape, size, size).astype(np.float32)

    def product(least: float) -> Product:
        light, view = (np.moveaxis(0.3 * maps(2, 4), 1, -1).copy() for _ in range(2))
        light[0, ..., 0], view[0, ..., 0] = least, 1.0
        return Product(light, view)

    up, across = (-(-own // side) for own, side in zip(texels, patch, strict=True))
    parts = {}
    for key, count in zip("YUV", counts, strict=True):
        coefficients = np.zeros((count, up, across, 4), np.float32)
        values = np.abs(random.normal(0, 0.6, (count, up, across)))
        coefficients[..., 0] = -np.sort(-values, 0) * random.choice([-1, 1], values.shape)
        for column, own in enumerate(rows, 1):
            coefficients[..., column] = random.integers(0, own, values.shape)
        coefficients[-(count // 3) :, ::2, ::2] = 0.0
        if key == "U":
            coefficients[:, -1, -1] = 0.0
        spread = random.normal(0, 0.5, (rows[0], *patch)).astype(np.float32)
        light, view = maps(rows[1]), maps(rows[2])
        if key == "Y":  # the mean of the logarithm
            coefficients[0] = (5.0, 0.0, 0.0, 0.0)
            spread[0] = light[0] = view[0] = 1.0
        parts[key] = Part(coefficients, spread, light, view)
    return SparseTables(parts, product(0.0), product(0.6), 0.2, 0.05, *texels)
