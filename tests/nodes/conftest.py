"""A model small enough to render often, and a way to render a socket's value."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.datasets.directions import spherical_to_unit
from addon.models.clustered_tucker import ClusteredTucker
from addon.tables.tables import Tables, build_tables

sys.path.append(str(Path(__file__).parents[1] / "models"))  # small_btf


@pytest.fixture(autouse=True)
def empty_file() -> None:
    """Each test starts from an empty .blend."""
    bpy.ops.wm.read_factory_settings(use_empty=True)


@pytest.fixture(scope="session")
def make_model() -> Callable[..., ClusteredTucker]:
    """A smooth random model: (clusters, mixtures, ranks, texels) -> ClusteredTucker."""

    def make(
        clusters: int = 3,
        mixtures: int = 2,
        ranks: tuple[int, int, int, int] = (6, 3, 5, 4),
        texels: tuple[int, int] = (12, 10),
        seed: int = 1,
    ) -> ClusteredTucker:
        rng = np.random.default_rng(seed)
        theta = [0.0, *[30.0] * 6, *[60.0] * 12]
        phi = [0.0, *np.arange(6) * 60.0, *np.arange(12) * 30.0]
        directions = spherical_to_unit(theta, phi)
        count = len(directions)
        smooth = np.column_stack([np.ones(count), directions])
        light = np.repeat(smooth, 3, 0) @ rng.standard_normal((4, ranks[0]))
        light += 0.1 * rng.standard_normal(light.shape)
        core = rng.standard_normal((clusters, *ranks)) / 10.0
        core[..., 0, 0, 0, 0] += 1.0
        spatial = [
            rng.standard_normal((clusters, size, 1, rank)) / rank
            for size, rank in zip(texels, ranks[2:], strict=True)
        ]
        view = rng.standard_normal((1, count, mixtures, ranks[1]))
        order = rng.permuted(np.tile(np.arange(clusters), (count, 1)), axis=1)
        members = np.sort(order[:, :mixtures], axis=1)
        return ClusteredTucker(
            core=core.astype(np.float32),
            bases={
                "light": light[None, :, None].astype(np.float32),
                "view": view.astype(np.float32),
                "y": spatial[0].astype(np.float32),
                "x": spatial[1].astype(np.float32),
            },
            members={"view": members.astype(np.uint32)} if clusters > 1 else {},
            clusters={"view": clusters} if clusters > 1 else {},
            dataset={
                "light": directions.tolist(),
                "view": directions.tolist(),
                "channels": ["R", "G", "B"],
                "patch_size": [0.01, 0.012],
                "periodic": True,
                "noise_floor_db": None,
                "source": {},
                "raw_bytes": 4,
            },
        )

    return make


@pytest.fixture(scope="session")
def tables(make_model: Callable[..., ClusteredTucker]) -> Tables:
    return build_tables(make_model(), size=64)
