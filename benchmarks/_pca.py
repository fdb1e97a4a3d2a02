"""Principal components of whole texels: all that is measured of each, lights, views and colours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from addon.datasets.dataset import Dataset


class Pca:
    """Principal components of texels: `mean` and orthonormal `columns` (values, count)."""

    def __init__(self, mean: NDArray[np.float32], columns: NDArray[np.float32]) -> None:
        self.mean, self.columns = mean, columns

    @classmethod
    def learned(cls, datasets: Sequence[Dataset], count: int, most: int = 600) -> Pca:
        """`count` components of, at most, `most` texels of each dataset: the inner products of all
        of them have to fit into memory."""
        rng = np.random.default_rng(0)
        rows = []
        for dataset in datasets:
            every = dataset.shape[2] * dataset.shape[3]
            rows.append(_texels(dataset, rng.choice(every, min(most, every), replace=False)))
        texels = np.concatenate(rows)
        mean = texels.mean(0)
        texels -= mean
        values, vectors = np.linalg.eigh((texels @ texels.T).astype(np.float64))
        scale = 1 / np.sqrt(values[-count:])
        columns = texels.T @ (vectors[:, -count:] * scale).astype(np.float32)
        return cls(mean, columns)

    def error(self, dataset: Dataset) -> float:
        """MSE of a dataset's texels, each projected on the components."""
        total = 0.0
        places = np.arange(dataset.shape[2] * dataset.shape[3])
        for some in np.array_split(places, 8):
            rows = _texels(dataset, some) - self.mean
            inside = rows @ self.columns
            total += float(np.vdot(rows, rows)) - float(np.vdot(inside, inside))
        return total / (len(places) * len(self.mean))

    def pictures(
        self, dataset: Dataset, pairs: Sequence[tuple[int, int]]
    ) -> list[NDArray[np.float32]]:
        """A dataset's texels projected on the components (y, x, channel), for pairs of light and
        view."""
        _, views, height, width, channels = dataset.shape
        inside = np.concatenate([
            (_texels(dataset, some) - self.mean) @ self.columns
            for some in np.array_split(np.arange(height * width), 8)
        ])  # fmt: skip
        found = []
        for light, view in pairs:
            first = (light * views + view) * channels
            rows = slice(first, first + channels)
            values = self.mean[rows] + inside @ self.columns[rows].T
            found.append(values.reshape(height, width, channels))
        return found


def _texels(dataset: Dataset, places: NDArray[np.integer]) -> NDArray[np.float32]:
    """Some texels (n, light * view * channel), all that is measured of each."""
    lights, views, height, width, channels = dataset.shape
    y, x = np.unravel_index(np.sort(places), (height, width))
    found = np.empty((len(places), lights, views * channels), np.float32)
    for light in range(lights):
        image = np.asarray(dataset.samples[light])
        found[:, light] = np.moveaxis(image[:, y, x], 1, 0).reshape(len(places), -1)
    return found.reshape(len(places), -1)
