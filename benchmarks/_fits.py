"""Settings of the fits that are measured, and the fits themselves on an opened dataset."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import nacre_native
import numpy as np
from numpy.typing import NDArray

from addon.datasets.dataset import Dataset, open_dataset

from . import numpy_kcta, numpy_mkcta


@dataclass(frozen=True)
class Settings:
    """ranks of (light rows, view, y, x); clusters and mixtures of each clustered mode."""

    ranks: tuple[int, int, int, int]
    clusters: dict[int, int]
    mixtures: dict[int, int]
    global_modes: tuple[int, ...]

    def __str__(self) -> str:
        parts = ["ranks " + "x".join(map(str, self.ranks))]
        if self.clusters:
            for name, values in (("C", self.clusters), ("K", self.mixtures)):
                parts.append(f"{name} " + "x".join(str(n) for n in values.values()))
        return ", ".join(parts)


WOOL_KCTA = Settings((20, 4, 32, 32), {1: 7}, {1: 3}, (0,))
CORDUROY_KCTA = Settings((20, 4, 80, 80), {1: 8}, {1: 3}, (0,))
GLOSSY_MKCTA = Settings((4, 4, 40, 40), {0: 8, 1: 10}, {0: 2, 1: 2}, (2, 3))


def native(
    dataset: Dataset,
    settings: Settings,
    iterations: int = 50,
    tolerance: float = 5e-4,
    threads: int = 0,
    progress: Callable[[float, str], bool] | None = None,
) -> dict[str, Any]:
    """The compiled fit; its defaults are its own. Tolerance 0 does every iteration."""
    directions = {0: dataset.light, 1: dataset.view}
    return nacre_native.fit_clustered(
        dataset.samples,
        settings.ranks,
        clusters=settings.clusters,
        mixtures=settings.mixtures,
        global_modes=settings.global_modes,
        directions={mode: directions[mode] for mode in settings.clusters},
        iterations=iterations,
        tolerance=tolerance,
        threads=threads,
        progress=progress,
    )


def first_labels(dataset: Dataset, settings: Settings) -> dict[int, NDArray[np.intp]]:
    """The first cluster of each item in the compiled fit, so that both start alike."""
    single = Settings(
        settings.ranks,
        settings.clusters,
        dict.fromkeys(settings.clusters, 1),
        settings.global_modes,
    )
    members = native(dataset, single, iterations=0)["members"]
    return {mode: members[mode][:, 0].astype(np.intp) for mode in settings.clusters}


def in_numpy(
    dataset: Dataset,
    settings: Settings,
    iterations: int,
    labels: dict[int, NDArray[np.intp]] | None = None,
) -> list[float]:
    """Errors of the numpy K-CTA (views clustered) or MK-CTA (lights and views)."""
    if 0 not in settings.clusters:
        _, _, errors = numpy_kcta.fit(
            dataset.samples, settings.ranks, settings.clusters[1], settings.mixtures[1],
            iterations, dataset.view, None if labels is None else labels[1],
        )  # fmt: skip
        return errors
    _, _, errors = numpy_mkcta.fit(
        dataset.samples, settings.ranks, (settings.clusters[0], settings.clusters[1]),
        (settings.mixtures[0], settings.mixtures[1]), iterations, (dataset.light, dataset.view),
        None if labels is None else (labels[0], labels[1]),
    )  # fmt: skip
    return errors


def decibels(error: float) -> float:
    """SNR of a relative squared error."""
    return float(-10 * np.log10(max(error, 1e-12)))


# Jobs for _child.measured: what is prepared, and the fit of it.


def opened(path: Path, *rest: Any) -> tuple[Any, ...]:
    """The dataset with its samples in the page cache, and the other arguments."""
    dataset = open_dataset(path)
    for row in dataset.samples:
        row.max()
    return dataset, *rest


def run_native(prepared: tuple[Any, ...]) -> tuple[list[float], int]:
    """Errors and iterations of (dataset, settings, iterations, tolerance, threads)."""
    result = native(*prepared)
    return list(result["errors"]), int(result["iterations"])


def run_numpy(prepared: tuple[Any, ...]) -> list[float]:
    """Errors of (dataset, settings, iterations, labels)."""
    return in_numpy(*prepared)
