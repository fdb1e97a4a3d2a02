"""Tables by hand or at random, and pictures of the engine; skipped where there is no GPU."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import bpy
import gpu
import numpy as np
import pytest

from addon.preview import context
from addon.tables.parabolic import texel_directions
from addon.tables.tables import Tables

sys.path.append(str(Path(__file__).parents[1] / "models"))  # small_btf


@pytest.fixture
def need_gpu() -> None:
    if not hasattr(gpu, "init"):
        pytest.skip("Blender 4.5 has no GPU in background")
    context.need_gpu()


@pytest.fixture(autouse=True)
def empty_file() -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)


@pytest.fixture
def random_tables() -> Callable[..., Tables]:
    """Tables of noise: every texel, rank and cluster differs from every other."""

    def make(
        clusters: tuple[int, int] = (1, 1),
        mixtures: tuple[int, int] = (1, 1),
        owners: tuple[int, int] = (1, 1),
        rank: int = 6,
        view_quads: int = 2,
        texels: tuple[int, int] = (12, 10),
        size: int = 32,
        occlusion: bool = False,
    ) -> Tables:
        rng = np.random.default_rng(5)

        def noise(*shape: int) -> np.ndarray:
            return rng.standard_normal(shape).astype(np.float32)

        def index(mode: int) -> np.ndarray:
            order = rng.permuted(np.tile(np.arange(clusters[mode]), (size * size, 1)), axis=1)
            chosen = order[:, : mixtures[mode]].T
            return chosen.reshape(-1, size, size).astype(np.uint32)

        quads = -(-rank // 4)
        light = noise(owners[0], 3, mixtures[0], quads, size, size, 4)
        return Tables(
            core=30 * noise(*clusters, rank, view_quads, *texels, 4),
            light=None if occlusion else light,
            view=noise(owners[1], mixtures[1], view_quads, size, size, 4),
            light_index=index(0),
            view_index=index(1),
        )

    return make


@pytest.fixture
def direction_tables() -> Tables:
    """A material that shows its light direction: (1 + l) / 2 in the tangent frame."""
    size = 256
    rows = np.zeros((1, 3, 1, 1, size, size, 4), np.float32)
    rows[0, :, 0, 0, :, :, 0] = np.moveaxis(0.5 + 0.5 * texel_directions(size), -1, 0)
    view = np.zeros((1, 1, 1, size, size, 4), np.float32)
    view[..., 0] = 1.0
    return Tables(
        core=np.ones((1, 1, 1, 1, 2, 2, 4), np.float32),
        light=rows,
        view=view,
        light_index=np.zeros((1, size, size), np.uint32),
        view_index=np.zeros((1, size, size), np.uint32),
    )


@pytest.fixture
def smooth_tables() -> Callable[..., Tables]:
    """Positive tables that change slowly with direction, but for one border of clusters each, so
    that pictures of two engines can be compared: (C_light, C_view) one more than (K_light, K_view)
    where clustered."""

    def make(mixtures: tuple[int, int] = (1, 2), apart: bool = False, texels=(12, 10)) -> Tables:
        rng = np.random.default_rng(7)
        size, rank, quads = 64, 5, 1
        directions = texel_directions(size)
        clusters = tuple(count + 1 if count > 1 else 1 for count in mixtures)
        owners = clusters[::-1] if apart else (1, 1)

        def rows(*shape: int) -> np.ndarray:
            slopes = rng.uniform(-0.4, 0.4, (*shape, 3))
            return (1.0 + slopes @ directions.reshape(-1, 3).T).reshape(*shape, size, size)

        def index(mode: int) -> np.ndarray:
            beyond = directions[..., mode] > 0.1
            members = np.arange(mixtures[mode])[:, None, None] + beyond
            return (members % clusters[mode]).astype(np.uint32)

        light = np.zeros((owners[0], 3, mixtures[0], 2, size, size, 4), np.float32)
        flat = rows(owners[0], 3, mixtures[0], rank)
        for number in range(rank):
            light[:, :, :, number // 4, :, :, number % 4] = flat[:, :, :, number]
        view = np.moveaxis(rows(owners[1], mixtures[1], quads, 4), 3, -1)
        return Tables(
            core=rng.uniform(0.1, 1.0, (*clusters, rank, quads, *texels, 4)).astype(np.float32),
            light=light * directions[..., 2:],
            view=view.astype(np.float32),
            light_index=index(0),
            view_index=index(1),
        )

    return make
