"""Small datasets and models."""

from math import prod

import numpy as np

from addon.datasets.dataset import DatasetWriter, open_dataset
from addon.models.clustered_tucker import MODES, ClusteredTucker


def hemisphere(count):
    """Unit directions (count, 3) on a spiral from the normal down to 80 degrees."""
    index = np.arange(count)
    theta = np.radians(80.0) * np.sqrt(index / max(count - 1, 1))
    phi = index * 2.399963229728653
    sine = np.sin(theta)
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), np.cos(theta)], -1)


def describe(lights, views, channels=3, **changes):
    return {
        "nacre": 1,
        "kind": "btf",
        "axes": ["light", "view", "y", "x", "channel"],
        "light": hemisphere(lights).tolist(),
        "view": hemisphere(views).tolist(),
        "channels": ["R", "G", "B"][:channels],
        "patch_size": [0.02, 0.01],
        "periodic": True,
        "noise_floor_db": None,
        "source": {"format": "btf", "file": "small.btf", "conversions": []},
        **changes,
    }


def make_samples(shape, seed=0, noise=0.05):
    """Samples that fall with the light's angle and vary smoothly with the view, with some noise."""
    lights, views, height, width, channels = shape
    rng = np.random.default_rng(seed)
    light, view = hemisphere(lights), hemisphere(views)
    texture = rng.random((height, width, channels))
    tilt = rng.normal(0.0, 0.4, (height, width, 2))
    shading = np.einsum("lvc,yxc->lvyx", light[:, None, :2] + view[:, :2], tilt)
    values = (light[:, 2, None, None, None] * np.exp(shading))[..., None] * texture
    return (values + noise * rng.random(shape)).astype(np.float32)


def write_dataset(path, shape=(6, 7, 8, 10, 3), samples=None, dtype=np.float32, **changes):
    samples = make_samples(shape) if samples is None else samples
    lights, views, _, _, channels = shape
    with DatasetWriter(path, describe(lights, views, channels, **changes), shape, dtype) as writer:
        writer.write(samples)
    return open_dataset(path)


def make_model(
    shape=(3, 4, 5, 6, 2), ranks=(3, 2, 2, 3), clusters=None, mixtures=None, shared=(), seed=0
):
    """A model of random numbers.

    `clusters` and `mixtures` of the clustered modes, in axis order; `shared` names the modes whose
    basis is one for all clusters; the others have one for each combination of the clusters of the
    clustered modes other than themselves.
    """
    rng = np.random.default_rng(seed)
    clusters, mixtures = clusters or {}, mixtures or {}
    lights, views, height, width, channels = shape
    sizes = dict(zip(MODES, (channels * lights, views, height, width), strict=True))
    bases, members = {}, {}
    for mode, rank in zip(MODES, ranks, strict=True):
        owners = prod(count for name, count in clusters.items() if name != mode)
        if mode in shared:
            owners = 1
        mixture = mixtures.get(mode, 1)
        bases[mode] = rng.normal(size=(owners, sizes[mode], mixture, rank)).astype(np.float32)
        if mode in clusters:
            items = lights if mode == "light" else sizes[mode]
            members[mode] = np.array(
                [sorted(rng.permutation(clusters[mode])[:mixture]) for _ in range(items)], np.uint32
            )
    core = rng.normal(size=(prod(clusters.values()), *ranks)).astype(np.float32)
    dataset = describe(lights, views, channels)
    kept = ("light", "view", "channels", "patch_size", "periodic", "noise_floor_db", "source")
    return ClusteredTucker(
        core=core,
        bases=bases,
        members=members,
        clusters=clusters,
        dataset={name: dataset[name] for name in kept},
        fit={"method": "test", "errors": [0.5]},
    )
