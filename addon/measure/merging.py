"""Parts of one virtual measurement, made on several machines, to the whole dataset."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..datasets.dataset import DESCRIPTION, Dataset, DatasetWriter, open_dataset
from ..errors import Cancelled, NacreError
from .noise import noise_floor_db

Progress = Callable[[float, str], bool]

# What a part has of its own: the first of its lights, and their noise.
_OWN = ("first", "noise")
_SHARED = ("kind", "view", "channels", "patch_size", "periodic")


def merge_parts(
    parts: Sequence[str | Path], path: str | Path, progress: Progress | None = None
) -> Dataset:
    """Join the datasets of all parts, in any order, into the dataset folder `path` and open it.

    The result is what `measure_btf` makes without parts. Raises NacreError for a dataset that is no
    part, parts of different measurements, lights that are missing or there twice, and a disk that
    cannot be written, Cancelled when `progress` answers False.
    """
    read = [_Part(open_dataset(part)) for part in parts]
    read.sort(key=lambda part: part.first)
    _check(read)
    description = read[0].description
    noise = [found for part in read for found in part.measurement["noise"]]
    description["light"] = [light for part in read for light in part.description["light"]]
    description["noise_floor_db"] = noise_floor_db(np.array(found) for found in noise)
    description["source"]["measurement"]["noise"] = noise
    samples = [part.dataset.samples for part in read]
    dtype = np.result_type(*(part.dtype for part in samples))
    shape = (len(description["light"]), *samples[0].shape[1:])
    with DatasetWriter(path, description, shape, dtype) as writer:
        for part in read:
            for light in part.dataset.samples:
                if progress and not progress(writer.fraction, f"Merging {part.dataset.path.name}"):
                    raise Cancelled
                writer.write(light)
        writer.add_files(lambda folder: _copy_side_channels(read[0].dataset, folder))
    return open_dataset(path)


class _Part:
    """A dataset and how it was measured."""

    def __init__(self, dataset: Dataset) -> None:
        self.dataset = dataset
        text = (dataset.path / DESCRIPTION).read_text(encoding="utf-8")
        self.description: dict[str, Any] = json.loads(text)
        self.measurement = dataset.source.get("measurement")
        if not isinstance(self.measurement, dict) or not {"of", *_OWN} <= self.measurement.keys():
            raise NacreError(f"{dataset.path.name} is no part of a measurement")

    @property
    def first(self) -> int:
        return self.measurement["first"]

    @property
    def shared(self) -> dict[str, Any]:
        """What all parts must agree on."""
        own = {key: value for key, value in self.measurement.items() if key not in _OWN}
        return {
            **own,
            **{key: self.description[key] for key in _SHARED},
            "texels": self.dataset.shape[2:4],
        }


def _check(parts: list[_Part]) -> None:
    name, shared = parts[0].dataset.path.name, parts[0].shared
    for part in parts:
        other = [key for key in shared | part.shared if part.shared.get(key) != shared.get(key)]
        if other:
            raise NacreError(
                f"{part.dataset.path.name} was measured with other {', '.join(other)} than {name}"
            )
    expected = 0
    for part in parts:
        if part.first > expected:
            raise NacreError(f"no part has the lights {expected + 1} to {part.first}")
        if part.first < expected:
            raise NacreError(f"{part.dataset.path.name} has lights that another part has, too")
        expected += len(part.dataset.light)
    if expected != shared["of"]:
        raise NacreError(f"no part has the lights {expected + 1} to {shared['of']}")


def _copy_side_channels(dataset: Dataset, folder: Path) -> None:
    for name in dataset.side_channels:
        shutil.copyfile(dataset.path / f"{name}.exr", folder / f"{name}.exr")
