"""Virtual measurement of a BTF: one Cycles render for each light direction."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..datasets.dataset import AXES, Dataset, DatasetWriter, check_destination, open_dataset
from ..errors import Cancelled, NacreError
from .cycles import add_light, aim
from .instrument import new_instrument, program
from .noise import energy_and_noise, noise_floor_db, samples_for, strips_rendered_twice
from .patch import Patch
from .settings import Settings
from .top_view import measure_top_view, write_side_channels
from .unfinished import Unfinished

Progress = Callable[[float, str], bool]

# What of dataset.json the pictures depend on.
_PICTURED = ("light", "view", "patch_size")


def measure_btf(
    patch: Patch,
    path: str | Path,
    light: np.ndarray,
    view: np.ndarray,
    settings: Settings,
    *,
    part: tuple[int, int] = (1, 1),
    origin: str = "",
    resume: bool = False,
    restart: bool = False,
    progress: Progress | None = None,
) -> Dataset:
    """Measure a patch into the dataset folder `path` and open it.

    `light` (L, 3) and `view` (V, 3) are unit vectors above the patch; the samples are
    (L, V, y, x, 3), float16 where that can hold them. Part (i, n) measures the i-th n-th of the
    lights, for `merge_parts`. Every picture has a seed of its own, `settings.seed` + its number.
    The noise floor comes from as many texels as a picture has, spread over lights and views and
    rendered twice.

    A measurement of the same patch, directions, settings and `origin`, which tells one state of the
    scene from another, that was cancelled or killed is gone on with, whatever finished pictures it
    left; the result has the same bits. `resume` does so with another origin, too, and `restart`
    throws the pictures away. Raises NacreError for an empty patch, a part without lights,
    directions below the horizon, an unfinished measurement of something else and a disk that cannot
    be written, Cancelled when `progress` answers False.
    """
    path = check_destination(path)
    first, last = (len(light) * (part[0] - 1 + end) // part[1] for end in (0, 1))
    if first == last:
        raise NacreError(f"part {part[0]} of {part[1]} is empty: there are {len(light)} lights")
    measurement = {
        "patch": patch.name or patch.collection.name,
        "origin": origin,
        "program": program(),
        **settings.described(),
        "first": first,
        "of": len(light),
    }
    description = {
        "nacre": 1,
        "kind": "btf",
        "axes": list(AXES),
        "light": light[first:last].tolist(),
        "view": view.tolist(),
        "channels": ["R", "G", "B"],
        "patch_size": list(patch.size),
        "periodic": True,
    }
    depends_on = {**measurement, **{key: description[key] for key in _PICTURED}}
    numbers = range(first, last)
    with Unfinished(path, depends_on, resume, restart) as unfinished:
        samples = _take_pictures(patch, light, view, settings, numbers, unfinished, progress)
        measurement["samples"] = samples
        _finish(path, patch, settings, description, measurement, unfinished)
        unfinished.remove()
    return open_dataset(path)


def _take_pictures(
    patch: Patch,
    light: np.ndarray,
    view: np.ndarray,
    settings: Settings,
    numbers: range,
    unfinished: Unfinished,
    progress: Progress | None,
) -> int:
    """Bring the unfinished measurement to all its pictures; how many samples they took."""
    samples = settings.samples if settings.noise_db is None else unfinished.samples()
    missing = [number for number in numbers if unfinished.load(number) is None]
    if not missing and samples is not None:
        return samples

    def step(done: int, message: str) -> None:
        """Fractions are of what is left to do now, so that they tell the time left."""
        if progress and not progress(done / max(len(missing), 1), message):
            raise Cancelled

    step(0, "Preparing")
    texels = settings.texels(patch.size)
    measured = new_instrument(patch, view, light, texels, settings.samples, settings.bounces)
    with measured as instrument:
        scene, tiles = instrument.scene, instrument.tiles
        sun = add_light(scene)

        def picture(number: int, count: int, seed: int, row: int | None = None) -> np.ndarray:
            scene.cycles.samples = count
            aim(sun, light[number])
            return instrument.picture(settings.seed + seed, row)[..., :3]

        twice = strips_rendered_twice(len(light), tiles.used_rows)
        if samples is None:
            assert settings.noise_db is not None

            def trial(count: int) -> float | None:
                step(0, f"Looking for the samples: {count}")
                seeds = 2 * len(light), 2 * len(light) + 1
                return noise_floor_db(
                    energy_and_noise(*(picture(number, count, seed, row) for seed in seeds))
                    for number, row in twice
                )

            samples = samples_for(settings.noise_db, trial)
            unfinished.save_samples(samples)
        for done, number in enumerate(missing):
            step(done, f"Measuring light {number + 1} of {len(light)}")
            values, noise = picture(number, samples, number), np.zeros(2)
            for row in [row for own, row in twice if own == number]:
                again = picture(number, samples, len(light) + number, row)
                noise += energy_and_noise(values[tiles.views(row)], again)
            unfinished.save(number, values, noise)
    return samples


def _finish(
    path: Path,
    patch: Patch,
    settings: Settings,
    description: dict[str, Any],
    measurement: dict[str, Any],
    unfinished: Unfinished,
) -> None:
    """From finished pictures to the dataset."""
    count = len(description["light"])
    numbers = range(measurement["first"], measurement["first"] + count)
    dtype, noise = np.dtype(np.float16), []
    for number in numbers:
        values, found = unfinished.finished(number)
        dtype = np.promote_types(dtype, values.dtype)
        noise.append(found)
    texels = settings.texels(patch.size)
    top = measure_top_view(patch, texels) if measurement["first"] == 0 else {}
    description |= {
        "noise_floor_db": noise_floor_db(noise),
        "side_channels": list(top),
        "source": {
            "format": "Cycles",
            "file": measurement["patch"],
            "conversions": [],
            "measurement": measurement | {"noise": [found.tolist() for found in noise]},
        },
    }
    shape = (count, len(description["view"]), texels[1], texels[0], 3)
    with DatasetWriter(path, description, shape, dtype) as writer:
        for number in numbers:
            writer.write(unfinished.finished(number)[0])
        writer.add_files(lambda folder: write_side_channels(folder, top))
