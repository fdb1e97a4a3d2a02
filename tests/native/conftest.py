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


@pytest.fixture(scope="session")
def samples():
    return make_samples()


@pytest.fixture(scope="session")
def views():
    return hemisphere(24)


@pytest.fixture
def fit(samples, views):
    """fit(**changes): K-CTA of the small material with 4 clusters, 2 mixtures."""

    def run(samples=samples, ranks=(6, 3, 4, 4), **changes):
        arguments = {"clusters": 4, "mixtures": 2, "directions": views} | changes
        return nacre_native.fit_kcta(samples, ranks, **arguments)

    return run
