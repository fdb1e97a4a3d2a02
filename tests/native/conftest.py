"""A small material that changes with the view, for the tests of the compiled module, which also use
the small models that lie beside the tests of models."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "models"))

nacre_native = pytest.importorskip("nacre_native")


def hemisphere(count):
    """`count` unit vectors on the upper hemisphere along a spiral, (count, 3)."""
    i = np.arange(count) + 0.5
    z, phi = 1 - i / count, i * np.pi * (3 - 5**0.5)
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(phi), radius * np.sin(phi), z], 1)


def make_samples(lights=6, views=24, height=8, width=7, channels=3, seed=5):
    """Bumps with coloured highlights and a little noise, (light, view, y, x, channel) float32."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(0, 0.35, (height, width, 3)) + (0, 0, 1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    light, view = hemisphere(lights), hemisphere(views)
    half = light[:, None] + view[None]
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    diffuse = np.clip(np.einsum("lc,yxc->lyx", light, normal), 0, None)[:, None]
    glossy = np.clip(np.einsum("lvc,yxc->lvyx", half, normal), 0, None) ** 30
    colour = rng.uniform(0.2, 0.9, (height, width, channels))
    samples = (
        diffuse[..., None] * colour
        + glossy[..., None]
        + rng.normal(0, 0.01, (lights, views, height, width, channels))
    )
    return samples.astype(np.float32)


def places(samples, mode):
    """Where the lights, views, rows or columns of samples lie: the directions of a fit."""
    count = samples.shape[mode]
    return hemisphere(count) if mode < 2 else np.arange(count)[:, None]


@pytest.fixture(scope="session")
def samples():
    return make_samples()


@pytest.fixture
def fit(samples):
    """fit(**changes): K-CTA of the small material with 4 view clusters, 2 mixtures."""

    def run(samples=samples, ranks=(6, 3, 4, 4), **changes):
        arguments = {"clusters": {1: 4}, "mixtures": {1: 2}, "global_modes": (0,)} | changes
        if "directions" not in arguments:
            modes = [m for m in arguments["clusters"] if m in range(4)]
            arguments["directions"] = {mode: places(samples, mode) for mode in modes}
        return nacre_native.fit_clustered(samples, ranks, **arguments)

    return run


@pytest.fixture
def fit_several(fit):
    """The same for MK-CTA with 3 light and 4 view clusters, 2 mixtures each."""

    def run(**changes):
        several = {
            "ranks": (3, 3, 4, 4),
            "clusters": {0: 3, 1: 4},
            "mixtures": {0: 2, 1: 2},
            "global_modes": (2,),
        }
        return fit(**(several | changes))

    return run
