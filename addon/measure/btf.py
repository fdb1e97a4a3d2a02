"""Virtual measurement of a BTF: one Cycles render for each light direction."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np

from ..datasets.dataset import AXES, Dataset, DatasetWriter, open_dataset
from ..errors import Cancelled
from .instrument import add_light, aim, new_instrument, render
from .patch import Patch

Progress = Callable[[float, str], bool]

# Lights that are rendered a second time, to see how much the noise changes the values.
NOISE_LIGHTS = 4


def measure_btf(
    patch: Patch,
    path: str | Path,
    light: np.ndarray,
    view: np.ndarray,
    *,
    texels: int = 64,
    samples: int = 8,
    bounces: int = 2,
    seed: int = 0,
    progress: Progress | None = None,
) -> Dataset:
    """Measure a patch into the dataset folder `path` and open it.

    `light` (L, 3) and `view` (V, 3) are unit vectors above the patch; the samples are float16
    (L, V, texels, texels, 3), each the mean of `samples` paths of up to `bounces` bounces over a
    texel. Every picture has a seed of its own, `seed` + its number. The dataset's noise floor comes
    from a few lights rendered twice. Raises NacreError for an empty patch, directions below the
    horizon and a disk that cannot be written, Cancelled when `progress` answers False.
    """
    description = {
        "nacre": 1,
        "kind": "btf",
        "axes": list(AXES),
        "light": light.tolist(),
        "view": view.tolist(),
        "channels": ["R", "G", "B"],
        "patch_size": [patch.size, patch.size],
        "periodic": True,
        "noise_floor_db": None,
        "source": {
            "format": "Cycles",
            "file": patch.collection.name,
            "conversions": [
                f"rendered with Cycles {bpy.app.version_string}: {samples} samples a texel, "
                f"{bounces} bounces, seed {seed}"
            ],
        },
    }
    twice = set(np.linspace(0, len(light) - 1, min(NOISE_LIGHTS, len(light))).round().astype(int))
    energy = noise = 0.0
    with (
        DatasetWriter(
            path, description, (len(light), len(view), texels, texels, 3), np.float16
        ) as writer,
        new_instrument(patch, view, light, texels, samples) as (scene, tiles),
    ):
        scene.cycles.max_bounces = bounces
        for kind in ("diffuse", "glossy", "transmission"):
            setattr(scene.cycles, f"{kind}_bounces", bounces)
        sun = add_light(scene)
        for number, direction in enumerate(light):
            if progress and not progress(number / len(light), "Measuring"):
                raise Cancelled
            aim(sun, direction)
            values = render(scene, tiles, seed + number)[..., :3]
            writer.write(values)
            if number in twice:
                again = render(scene, tiles, seed + len(light) + number)[..., :3]
                energy += float(np.square(values, dtype=np.float64).sum())
                noise += float(np.square(values - again, dtype=np.float64).sum()) / 2
        if noise > 0 and energy > 0:
            description["noise_floor_db"] = round(10 * math.log10(energy / noise), 2)
    return open_dataset(path)
