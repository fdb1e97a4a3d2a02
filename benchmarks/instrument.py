"""What a virtual measurement costs beyond the bare ray tracing: `python -m benchmarks.instrument`.

A BTF of 81 x 81 directions and 64 x 64 texels with 16 samples, its noise floor, side channels,
files and all, against one render of as many pixels and samples: once with the same camera, the same
views filling one large picture, and once with Blender's own orthographic camera.
"""

from __future__ import annotations

import argparse
import importlib
import resource
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from math import isqrt
from pathlib import Path

import bpy
import numpy as np

from addon.datasets.direction_sets import ubo_81
from addon.measure.btf import measure_btf
from addon.measure.cycles import add_light, aim, render
from addon.measure.instrument import new_instrument
from addon.measure.patch import Patch
from addon.measure.settings import Settings
from addon.render.stage import add_camera

BOUNCES = 2
# A light in the middle of the set.
LIGHT = 40


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.instrument", description=__doc__)
    parser.add_argument("--recipe", default="studs", help="of benchmarks/recipes")
    parser.add_argument("--texels", type=int, default=64)
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--lights", type=int, default=81, help="a square number")
    options = parser.parse_args()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    patch = importlib.import_module(f".recipes.{options.recipe}", __package__).build()
    view = ubo_81()
    light = view[np.linspace(0, 80, options.lights).round().astype(int)]
    pixels = options.lights * len(view) * options.texels**2
    with timed() as measured, tempfile.TemporaryDirectory() as folder:
        settings = Settings(options.texels, options.samples, bounces=BOUNCES)
        dataset = measure_btf(patch, Path(folder) / "a.nacre", light, view, settings)
    floor = dataset.noise_floor_db
    print(f"{options.recipe}, {pixels:,} texels, {options.samples} samples, {BOUNCES} bounces")
    print(f"measured, noise floor {floor} dB: {measured[0]:.1f} s, {measured[1]:.1f} s of CPU")
    texels = options.texels * isqrt(options.lights)
    for name, own in (("same camera", False), ("Blender's camera", True)):
        with timed() as bare:
            render_at_once(patch, view, light[len(light) // 2], texels, options.samples, own)
        print(
            f"one render, {name}: {bare[0]:.1f} s, {bare[1]:.1f} s of CPU; measuring costs "
            f"{measured[0] / bare[0]:.3f} of it, {measured[1] / bare[1]:.3f} of the CPU"
        )


def render_at_once(
    patch: Patch, view: np.ndarray, light: np.ndarray, texels: int, samples: int, own: bool
) -> None:
    """All pixels in one picture; with Blender's `own` camera, all from one view."""
    sizes = (texels, texels)
    with new_instrument(patch, view, light[None], sizes, samples, BOUNCES) as instrument:
        scene = instrument.scene
        aim(add_light(scene), light)
        if own:
            camera = add_camera(scene, (45.0, 20.0), max(patch.size))
            camera.location *= patch.size[0]
            camera.data.clip_start = 1e-6
        render(scene, 0)


@contextmanager
def timed() -> Iterator[list[float]]:
    """Wall-clock and CPU seconds, once the block has ended."""
    found: list[float] = []
    begun, used = time.monotonic(), _cpu()
    yield found
    found += [time.monotonic() - begun, _cpu() - used]


def _cpu() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    main()
