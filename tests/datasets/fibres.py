"""Masks of woven fibres with thickness, seen by parallel rays: small, but with true parallax."""

import numpy as np

from addon.datasets.dataset import DatasetWriter, open_dataset
from addon.datasets.directions import spherical_to_unit


def views(rings=(0, 15, 30, 45, 60), around=6):
    """Unit directions on rings, one at the normal."""
    angles = [
        (theta, 360.0 * step / around) for theta in rings for step in range(around if theta else 1)
    ]
    return spherical_to_unit(*zip(*angles, strict=True))


def fibre_masks(directions, size=32, threads=2, radius=0.09, height=0.08):
    """Masks (view, y, x) bool of a periodic plain weave; lengths in patch widths.

    Fibres are swept spheres: a texel is covered where its ray passes a centre within the radius.
    """
    along = (np.arange(40) + 0.5) / 40
    centres = []
    for number in range(threads):
        across = np.full(40, (number + 0.4) / threads) + 0.03 * np.sin(2 * np.pi * along + number)
        lift = height * np.cos(np.pi * (threads * along + number))
        centres += [np.stack([along, across, lift], -1), np.stack([across, along, -lift], -1)]
    centres = np.concatenate(centres)
    texel = (np.arange(size) + 0.5) / size
    masks = np.empty((len(directions), size, size), bool)
    for mask, (x, y, z) in zip(masks, directions, strict=True):
        seen = centres[:, :2] - np.outer(centres[:, 2] / z, (x, y))
        dx, dy = ((texel - part[:, None] + 0.5) % 1.0 - 0.5 for part in seen.T)
        dx, dy = dx[:, None, :], dy[:, :, None]
        mask[...] = (dx**2 + dy**2 - (x * dx + y * dy) ** 2 <= radius**2).any(0)
    return masks


def describe_occlusion(directions, **changes):
    return {
        "nacre": 1,
        "kind": "occlusion",
        "axes": ["view", "y", "x"],
        "view": np.asarray(directions).tolist(),
        "value": "mask",
        "patch_size": [0.02, 0.01],
        "periodic": True,
        "noise_floor_db": None,
        "source": {"format": "masks", "file": "fibres.npy", "conversions": []},
        **changes,
    }


def write_occlusion(path, samples, directions=None, dtype=np.float16, **changes):
    directions = views()[: len(samples)] if directions is None else directions
    description = describe_occlusion(directions, **changes)
    with DatasetWriter(path, description, samples.shape, dtype) as writer:
        writer.write(samples)
    return open_dataset(path)
