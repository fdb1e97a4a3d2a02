"""Tables in the shape of a model, to time what does not depend on the numbers in them."""

from __future__ import annotations

import numpy as np

from addon.tables.tables import Tables


def random_tables(
    clusters: tuple[int, int], mixtures: tuple[int, int], ranks: tuple[int, int], texels: int = 128
) -> Tables:
    """Tables of random numbers in the shape of a model; (light, view) each."""
    rng = np.random.default_rng(0)
    size = 256

    def noise(*shape: int) -> np.ndarray:
        return rng.random(shape, np.float32)

    def index(mode: int) -> np.ndarray:
        # Directions beside each other share clusters, as those of a fit do.
        y, x = np.mgrid[:size, :size] // 64
        first = (x + 3 * y)[None] + np.arange(mixtures[mode])[:, None, None]
        return (first % clusters[mode]).astype(np.uint32)

    light, view = (-(-rank // 4) for rank in ranks)
    owners = (clusters[1], clusters[0]) if clusters[0] > 1 else (1, 1)
    return Tables(
        core=noise(*clusters, ranks[0], view, texels, texels, 4),
        light=noise(owners[0], 3, mixtures[0], light, size, size, 4),
        view=noise(owners[1], mixtures[1], view, size, size, 4),
        light_index=index(0),
        view_index=index(1),
    )
