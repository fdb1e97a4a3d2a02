"""How near each stage of a fit comes to what this machine can do.

The least time of a stage is the work that benchmarks/_operations.py counts, from documented
formulas, over the machine's rate of single-precision products or its memory bandwidth, whichever
takes longer; both rates are measured in the same run, with the same BLAS and as many threads. The
share of a stage is that over the time it took, from the fit's own progress messages; the last line
weights stages by their time. The bar: 50 %.

Two sizes: the K-CTA paper's 81x81x128x128 RGB, and SparseBTF's 151x151 directions with 64x64 RGB
texels (a whole UBO2014 material, 400x400, is 21 GB).
"""

from __future__ import annotations

import re
import tempfile
import time

import nacre_native

from addon.datasets.dataset import Dataset

from . import _machine
from ._fits import CORDUROY_KCTA, Settings, native
from ._materials import denser, patchwork
from ._operations import Counts
from .numpy_mkcta import FIRST_GAIN, FIRST_ITERATIONS

NSVD = Settings((20, 32, 80, 80), {}, {}, ())
MKCTA = Settings((4, 4, 80, 80), {0: 8, 1: 10}, {0: 2, 1: 2}, (2, 3))
FITS = {"N-SVD": NSVD, "K-CTA": CORDUROY_KCTA, "MK-CTA": MKCTA}


def main() -> None:
    products, moved = _machine.report()
    total = [0.0, 0.0]
    with tempfile.TemporaryDirectory() as folder:
        for dataset in (patchwork(folder, 128), denser(folder)):
            for name, settings in FITS.items():
                ranks = tuple(
                    min(a, b) for a, b in zip(settings.ranks, _room(dataset), strict=True)
                )
                fitted = Settings(
                    ranks, settings.clusters, settings.mixtures, settings.global_modes
                )
                for i, seconds in enumerate(_report(name, dataset, fitted, products, moved)):
                    total[i] += seconds
    print(f"\nall stages of all fits: {total[0] / total[1]:.0%} of {total[1]:.1f} s")


def _room(dataset: Dataset) -> tuple[int, int, int, int]:
    """The largest ranks: those of y and x at most five eighths of the mode, as at paper size."""
    lights, views, height, width, channels = dataset.shape
    return channels * lights, views, height * 5 // 8, width * 5 // 8


def _report(
    name: str, dataset: Dataset, settings: Settings, products: float, moved: float
) -> tuple[float, float]:
    """Print the stages of one fit; returns its least time and its time."""
    stages, single = _timed(dataset, settings)
    lights, views, height, width, channels = dataset.shape
    counts = Counts((channels * lights, views, height, width), settings)
    print(f"\n{name} {settings}, {'x'.join(map(str, dataset.shape))}")
    print(f"  {'stage':<34}{'GFLOP':>8}{'GB':>7}{'seconds':>9}{'share':>8}")
    sums = [0.0, 0.0]
    rows: dict[str, list[float]] = {}
    for message, seconds in stages:
        parts = counts.stage(message, mixtures=message.split(":")[0] not in single)
        row = rows.setdefault(re.sub(r" \d+", "", message), [0.0] * 4)
        least = sum(part.seconds(products, moved) for part in parts)
        found = [sum(p.operations for p in parts), sum(p.bytes for p in parts), seconds, least]
        for i, value in enumerate(found):
            row[i] += value
        sums[0] += least
        sums[1] += seconds
    for message, (operations, data, seconds, least) in rows.items():
        share = least / seconds if seconds else 0
        print(f"  {message:<34}{operations / 1e9:8.1f}{data / 1e9:7.2f}{seconds:9.3f}{share:8.0%}")
    print(f"  {'whole fit':<49}{sums[1]:9.3f}{sums[0] / sums[1]:8.0%}")
    return sums[0], sums[1]


def _timed(dataset: Dataset, settings: Settings) -> tuple[list[tuple[str, float]], set[str]]:
    """Stages and their seconds, and those of MK-CTA's iterations with one mixture cluster."""
    begun: list[tuple[float, str]] = []

    def progress(_fraction: float, message: str) -> bool:
        if not begun or begun[-1][1] != message:
            begun.append((time.perf_counter(), message))
        return True

    started = time.perf_counter()
    if settings.clusters:
        errors = native(dataset, settings, progress=progress)["errors"]
    else:
        nacre_native.fit_nsvd(dataset.samples, settings.ranks, progress=progress)
        errors = []
    ended = time.perf_counter()
    # What comes before the first message belongs to the first stage.
    times = [started, *(at for at, _ in begun[1:]), ended]
    stages = [(begun[i][1], times[i + 1] - times[i]) for i in range(len(begun))]
    single = 0
    if len(settings.clusters) > 1:
        single = 1
        while (
            single < min(FIRST_ITERATIONS, len(errors) - 1)
            and errors[single - 1] - errors[single] > FIRST_GAIN * errors[single]
        ):
            single += 1
    return stages, {f"Iteration {i + 1}" for i in range(single)}


if __name__ == "__main__":
    main()
