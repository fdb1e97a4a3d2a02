"""What the processing before the dictionaries is worth, in the form of the paper's Table 2.

    python -m benchmarks.sparse_processing [FOLDER]

FOLDER is that of benchmarks.sparse_quality. The same training and coding, of patches side by side
(a quarter of that benchmark's) and fewer dictionaries, of colours that are processed more and more:
linear R, G and B as they are (Miandji et al. 2019, the other row of the paper's table), then Y, U
and V, then each image less its mean, then Nacre's log(1 + RGB / 8); and as the paper has it,
log(RGB + 10^-5), one mean of an image's three channels, and over the deviation from it. Equal
bytes; the coefficients are divided among channels as models/sparse/split.py does it, but for the
paper's, which is 8 to 1 to 1. MSE of linear values, times 10^4.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import nacre_native
import numpy as np
from numpy.typing import NDArray

from addon.datasets.dataset import Dataset
from addon.models.domain import TO_RGB, TO_YUV
from addon.models.sparse.ensemble import Ensemble
from addon.models.sparse.model import Codes, SparseBtf, room_of
from addon.models.sparse.patches import tiling
from addon.models.sparse.split import divided
from addon.models.sparse.subspace import Subspace
from addon.models.sparse.training import SPARSITY, SUBSPACE
from addon.models.sparse.transform import OFFSET, Normalisation

from ._report import table
from ._sparse_sets import SETS, TRAINING, UNSEEN, datasets, parser

CHANNELS = "YUV"
DICTIONARIES, SWEEPS = 4, 6
PATCH = (SETS["ubo151"][2],) * 2
QUALITIES = (32, 128)
AUTHORS_OFFSET = 1e-5

Values = NDArray[np.floating]


@dataclass(frozen=True)
class Processing:
    """Colours as they are coded, and back.

    `images` gives of an image's values (y, x, 3) its means (3,) and its deviation."""

    name: str
    to: Callable[[Values], Values]
    back: Callable[[Values], Values]
    images: Callable[[Values], tuple[Values, float]]
    weights: Values
    """What a coefficient of each channel counts in R, G and B."""

    division: Sequence[int] = ()
    """Of coefficients among the channels, where they are not divided by the dataset."""


def main() -> None:
    folder = parser("sparse_processing", __doc__).parse_args().folder
    learned, unseen = (datasets(names, folder, "ubo151") for names in (TRAINING, UNSEEN))
    rows = []
    for processing in stages():
        ensemble = trained([*learned.values()], processing, folder)
        cells = []
        for dataset in unseen.values():
            cells += [f"{1e4 * e:.2f}" for e in errors(dataset, processing, ensemble)]
        rows.append([processing.name, *cells])
        print(*rows[-1], flush=True)
    heads = [f"{name}, SparseBTF ({quality})" for name in UNSEEN for quality in QUALITIES]
    print(table([["", *heads], *rows]))


def stages() -> list[Processing]:
    """From nothing to all of it, and the paper's."""
    to_yuv, to_rgb = (np.asarray(m.T, np.float32) for m in (TO_YUV, TO_RGB))
    as_it_is, yuv_weights = np.ones(3), np.linalg.norm(TO_RGB, axis=0)

    def logarithm(rgb: Values, offset: float) -> Values:
        return np.log1p(np.maximum(rgb, 0) / np.float32(offset)) @ to_yuv

    def exponential(values: Values, offset: float) -> Values:
        largest = np.float32(np.log(1e4 / offset))
        return np.expm1(np.minimum(values @ to_rgb, largest)) * np.float32(offset)

    def of_log(offset: float) -> tuple[Callable[[Values], Values], Callable[[Values], Values]]:
        return partial(logarithm, offset=offset), partial(exponential, offset=offset)

    def yuv(values: Values) -> Values:
        return values @ to_yuv

    def rgb(values: Values) -> Values:
        return values @ to_rgb

    return [
        Processing("RGB", np.asarray, np.asarray, nothing, as_it_is),
        Processing("YUV", yuv, rgb, nothing, yuv_weights),
        Processing("YUV, means", yuv, rgb, mean_of_each, yuv_weights),
        Processing("YUV, means, log (Nacre)", *of_log(OFFSET), mean_of_each, yuv_weights),
        Processing("the paper's", *of_log(AUTHORS_OFFSET), mean_and_deviation, yuv_weights,
                   (8, 1, 1)),
    ]  # fmt: skip


def nothing(values: Values) -> tuple[Values, float]:
    return np.zeros(3), 1.0


def mean_of_each(values: Values) -> tuple[Values, float]:
    return values.mean((0, 1), dtype=np.float64), 1.0


def mean_and_deviation(values: Values) -> tuple[Values, float]:
    return np.full(3, values.mean()), max(float(values.std()), 1e-6)


class Processed:
    """The patches of a dataset as they are coded."""

    def __init__(self, dataset: Dataset, processing: Processing) -> None:
        self.dataset, self.processing = dataset, processing
        height, width = dataset.shape[2:4]
        self.origins = tiling(height, width, PATCH)
        lights, views = dataset.shape[:2]
        mean = np.empty((lights, views, 3), np.float32)
        deviation = np.empty((lights, views), np.float32)
        for light in range(lights):
            for view, values in enumerate(processing.to(self._samples(light))):
                mean[light, view], deviation[light, view] = processing.images(values)
        self.images = Normalisation(mean, deviation, 0.0)

    def _samples(self, *part: int | slice) -> NDArray[np.float32]:
        return np.asarray(self.dataset.samples[part], np.float32)

    def colours(self, y: int, x: int) -> NDArray[np.float32]:
        """Linear (light, view, y, x, 3) of one patch."""
        return self._samples(*(slice(None),) * 2, slice(y, y + PATCH[0]), slice(x, x + PATCH[1]))

    def patches(self) -> Iterator[NDArray[np.float32]]:
        """(3, y, x, light, view) of each."""
        mean = self.images.mean[:, :, None, None]
        deviation = self.images.deviation[..., None, None, None]
        for origin in self.origins:
            values = (self.processing.to(self.colours(*origin)) - mean) / deviation
            yield np.ascontiguousarray(values.transpose(4, 2, 3, 0, 1), np.float32)


def trained(materials: list[Dataset], processing: Processing, folder: Path) -> Ensemble:
    """Dictionaries of each channel."""
    processed = [Processed(dataset, processing) for dataset in materials]
    total = sum(len(one.origins) for one in processed)
    shape = (total, *PATCH, *materials[0].shape[:2])
    found = {}
    with tempfile.TemporaryDirectory(prefix=".patches-", dir=folder) as scratch:
        paths = [Path(scratch, f"{key}.npy") for key in CHANNELS]
        files = [np.lib.format.open_memmap(path, "w+", np.float16, shape) for path in paths]
        for number, patch in enumerate(p for one in processed for p in one.patches()):
            for file, values in zip(files, patch, strict=True):
                file[number] = values
        for key, file, path in zip(CHANNELS, files, paths, strict=True):
            within = Subspace.of(file, SUBSPACE)
            reduced, _ = within.reduce(file, path.with_suffix(".reduced.npy"))
            result = nacre_native.fit_ensemble(
                reduced, dictionaries=DICTIONARIES, sparsity=SPARSITY[key], sweeps=SWEEPS
            )
            found[key] = tuple(within.expand(result["dictionaries"]))
    return Ensemble(PATCH, materials[0].light, materials[0].view, found, 0.0)


def errors(dataset: Dataset, processing: Processing, ensemble: Ensemble) -> Iterator[float]:
    """The MSE of linear values at each quality."""
    processed = Processed(dataset, processing)
    most = room_of(QUALITIES[-1], tuple(CHANNELS), PATCH)
    found: dict[str, list[dict[str, NDArray]]] = {key: [] for key in CHANNELS}
    for patch in processed.patches():
        for key, values in zip(CHANNELS, patch, strict=True):
            codes = nacre_native.code_patches(values[None], ensemble.dictionaries[key], most)
            found[key].append(codes)
    codes = {key: Codes(*(np.concatenate([one[name] for one in own]).T
                          for name in ("positions", "values", "members"))).rounded()
             for key, own in found.items()}  # fmt: skip
    height, width = dataset.shape[2:4]
    whole = SparseBtf(height, width, ensemble, processed.images, codes, dataset={})
    for quality in QUALITIES:
        room = room_of(quality, tuple(CHANNELS), PATCH)
        counts = _divided(codes, processing, room, len(processed.origins))
        model = replace(whole, codes={key: own.first(counts[key]) for key, own in codes.items()})
        total = 0.0
        for y, x in processed.origins:
            part = {"y": slice(y, y + PATCH[0]), "x": slice(x, x + PATCH[1])}
            # What the model takes for logarithms is what this processing makes of the colours.
            difference = processing.back(model.logarithms(**part)) - processed.colours(y, x)
            total += float(np.mean(np.square(difference, dtype=np.float64)))
        yield total / len(processed.origins)


def _divided(
    codes: dict[str, Codes], processing: Processing, room: int, patches: int
) -> dict[str, int]:
    if processing.division:
        whole = sum(processing.division)
        shares = [room * share // whole for share in processing.division]
        return dict(zip(CHANNELS, shares, strict=True))
    magnitudes = {key: np.abs(codes[key].values.ravel()) * weight
                  for key, weight in zip(CHANNELS, processing.weights, strict=True)}  # fmt: skip
    return divided(magnitudes, room, patches)


if __name__ == "__main__":
    main()
