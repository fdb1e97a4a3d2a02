"""A small sparse model whose rows change slowly with the direction."""

from __future__ import annotations

import numpy as np

from addon.datasets.direction_sets import ubo_81, uniform
from addon.models.sparse.ensemble import Ensemble
from addon.models.sparse.model import Codes, SparseBtf
from addon.models.sparse.transform import Normalisation


def smooth(directions: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Orthonormal columns that change slowly from one direction to the next: (count of columns)."""
    random = np.random.default_rng(seed)
    x, y, z = directions.T
    basis = np.stack([np.ones_like(x), x, y, z, x * y, x * x - y * y, x * z, y * z], 1)
    rest = random.normal(size=(len(x), len(x) - basis.shape[1]))
    whole = np.linalg.qr(np.hstack([basis, rest]))[0]
    assert count <= basis.shape[1]
    return whole


def model_of(parts: str = "", seed: int = 0, own_means: bool = True) -> SparseBtf:
    """10 x 9 texels in patches of 4 x 4, two dictionaries; coefficients only on smooth atoms."""
    random = np.random.default_rng(seed)
    light, view = uniform(40), ubo_81()
    tall = wide = 4
    keys = (parts,) if parts else ("Y", "U", "V")
    dictionaries, codes = {}, {}
    for number, key in enumerate(keys):
        spatial = [
            np.stack([np.linalg.qr(random.normal(size=(size, size)))[0] for _ in range(2)])
            for size in (tall, wide)
        ]
        angular = [
            np.stack([smooth(own, 8, 10 * number + k) for k in range(2)]) for own in (light, view)
        ]
        colour = [np.stack([np.linalg.qr(random.normal(size=(3, 3)))[0]] * 2)] if parts else []
        modes = [own.astype(np.float32) for own in (*spatial, *angular, *colour)]
        dictionaries[key] = tuple(modes)
        count, patches = 12, 3 * 3
        places = [random.integers(0, 4, (count, patches)) for _ in range(2)]
        places += [random.integers(0, 8, (count, patches)) for _ in range(2)]
        places += [random.integers(0, 3, (count, patches)) for _ in colour]
        positions = np.ravel_multi_index(places, [own.shape[2] for own in modes])
        values = np.sort(np.abs(random.normal(0, 3, (count, patches))), 0)[::-1]
        values[-2:, ::2] = 0.0  # not all patches have all of them
        codes[key] = Codes(
            np.where(values != 0, positions, 0).astype(np.uint32),
            values.astype(np.float32),
            random.integers(0, 2, patches).astype(np.uint32),
        )
    mean = 1.5 + np.outer(light[:, 2], view[:, 2]) + 0.3 * np.outer(light[:, 0], view[:, 1])
    if own_means:
        means = np.stack([mean, 0.1 * mean, 0.2 - 0.1 * mean], -1)
        deviation = np.ones_like(mean)
    else:  # one of all channels, and a deviation, as the authors have them
        means = np.repeat(0.3 * mean[..., None], 3, -1)
        deviation = 0.4 + 0.2 * np.outer(light[:, 2], view[:, 2])
    return SparseBtf(
        height=10,
        width=9,
        ensemble=Ensemble((tall, wide), light, view, dictionaries, 0.1),
        normalised=Normalisation(means.astype(np.float32), deviation.astype(np.float32), 0.1),
        codes=codes,
        dataset={
            "light": light.tolist(),
            "view": view.tolist(),
            "channels": ["R", "G", "B"],
            "patch_size": [0.009, 0.01],
            "periodic": True,
            "noise_floor_db": None,
            "source": {},
        },
        quality=16,
    )
