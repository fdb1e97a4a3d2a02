"""The four tensor models behind one function: settings in the papers' terms, fit and sizes."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import cache
from math import log10, prod
from pathlib import Path

from addon.datasets.dataset import Dataset
from addon.models.clustered_tucker import MODES, ClusteredTucker
from addon.models.exr import save_model
from addon.models.fit import compress

MIB = 2**20
"""The papers' MB."""


@dataclass(frozen=True)
class Settings:
    """ranks of (light rows, view, y, x); clusters and mixtures of (light, view), 1 for none.

    Global are the modes of the papers' tables: light for CTA and K-CTA, x and y for MK-CTA.
    """

    ranks: tuple[int, int, int, int]
    clusters: tuple[int, int] = (1, 1)
    mixtures: tuple[int, int] = (1, 1)
    search: str = "auto"
    coarse: int = 1

    @property
    def method(self) -> str:
        if self.clusters[0] > 1:
            return "mkcta"
        if self.clusters[1] > 1:
            return "kcta" if self.mixtures[1] > 1 else "cta"
        return "nsvd"

    def count(self, shape: tuple[int, ...]) -> int:
        """How many numbers the model of a dataset of this shape stores, indices aside."""
        lights, views, height, width, channels = shape
        light, view, y, x = self.ranks
        cores = prod(self.clusters)
        multiway = self.method == "mkcta"
        light_owners, view_owners = self.clusters[::-1] if multiway else (1, 1)
        return (
            cores * prod(self.ranks)
            + channels * lights * light * self.mixtures[0] * light_owners
            + views * view * self.mixtures[1] * view_owners
            + (height * y + width * x) * (1 if multiway else cores)
        )

    def mb(self, shape: tuple[int, ...]) -> float:
        """The papers' size: half floats, in MB of 2^20 bytes."""
        return 2 * self.count(shape) / MIB


@dataclass(frozen=True)
class Fit:
    """What a fit gave: the model, SNR (dB), seconds, SNR by iteration after the first guess."""

    model: ClusteredTucker
    snr: float
    seconds: float
    by_iteration: tuple[float, ...]
    file_bytes: int

    @property
    def mb(self) -> float:
        """The papers' size: half floats, in MB of 2^20 bytes."""
        bases = sum(basis.size for basis in self.model.bases.values())
        return 2 * (self.model.core.size + bases) / MIB


@cache
def fit(dataset: Dataset, settings: Settings) -> Fit:
    """Fit and save one model; the same settings are fitted once."""
    clustered = {
        mode: (clusters, mixtures)
        for mode, clusters, mixtures in zip(
            MODES[:2], settings.clusters, settings.mixtures, strict=True
        )
        if clusters > 1
    }
    model = compress(
        dataset,
        settings.method,
        ranks=dict(zip(MODES, settings.ranks, strict=True)),
        clusters={mode: clusters for mode, (clusters, _) in clustered.items()},
        mixtures={mode: mixtures for mode, (_, mixtures) in clustered.items()},
        search=settings.search,
        coarse=settings.coarse,
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.exr"
        save_model(model, path)
        size = path.stat().st_size
    return Fit(
        model=model,
        snr=model.fit["snr_db"],
        seconds=model.fit["seconds"],
        by_iteration=tuple(decibels(error) for error in model.fit["errors"]),
        file_bytes=size,
    )


def decibels(error: float) -> float:
    """SNR of a relative squared error."""
    return -10.0 * log10(max(error, 1e-12))
