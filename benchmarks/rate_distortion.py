"""Targets in dB against grid searches over ranks, clusters and mixtures.

`python -m benchmarks.rate_distortion [FOLDER] [--only NAME ...]`; FOLDER holds rendered datasets,
of which two are taken besides the measured ones.

The grids have multiples of 4 as ranks (4 of the view mode where it is clustered), the same of y and
x, every fourth number of clusters, and 2 and 3 mixtures. A setting is left out where it cannot be
the best one: where the truncation of a larger fit misses the target by far, or where it has a third
more numbers than the best so far. Its file is compared as `compress` saves it, and rounded to the
target like ours.
"""

from __future__ import annotations

import itertools
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from addon.datasets.dataset import Dataset
from addon.models.clustered_tucker import ClusteredTucker
from addon.models.fit import compress, mode_sizes
from addon.models.landing import MOST, saved_bytes
from addon.models.precision import SHARE, round_model
from addon.models.rate_distortion import Regained, truncations
from addon.models.target import compress_to_target
from addon.models.target_search import RANK

from ._data import OUT, arguments, materials
from ._plots import COLOURS, STYLE, _save, plt
from ._report import bar, table

LARGER = 1.05
"""How much larger than the best of the grid a file may be."""
TARGETS = {"nsvd": 2.0, "kcta": 0.0}
"""Methods, and how far above the middle quality of a material their target is, in dB."""

_MIDDLE = {"light": 20, "view": 28, "y": 32, "x": 32}  # ranks of N-SVD at medium quality
_LARGEST = {"light": 40, "view": 72, "y": 48, "x": 48}  # ranks of the grid
_CLUSTERS = range(6, 23, 4)
_MIXTURES = (2, 3)
_REGAINED = Regained(0.3, 0.5)  # more of a truncation's loss than any smaller fit regains
_MORE_NUMBERS = 1.35


@dataclass(frozen=True)
class Found:
    """A setting of the grid that reaches the target, and its files in bytes."""

    settings: dict[str, Any]
    snr_db: float
    numbers: int
    saved: int
    rounded: int


def main() -> None:
    options = arguments("rate_distortion", __doc__)
    found = materials(options.folder, options.only)
    rows = [["", "method", "target", "landed", "MB", "fits", "s",
             "grid", "its best, MB", "ours", "as saved, MB", "ours"]]  # fmt: skip
    bars = []
    for name in list(found)[:4]:
        dataset = found[name]
        middle = _middle(dataset)
        for method, above in TARGETS.items():
            target = round(middle + above, 1)
            with tempfile.TemporaryDirectory() as folder:
                started = time.monotonic()
                ours = compress_to_target(dataset, method, snr_db=target, folder=Path(folder))
                seconds = time.monotonic() - started
                size = saved_bytes(ours, Path(folder))
                others = [*_grid(dataset, method, target, Path(folder))]
            rounded = min(others, key=lambda one: one.rounded)
            saved = min(others, key=lambda one: one.saved)
            landed = ours.fit["snr_db"]
            rows.append(
                [
                    name,
                    method,
                    f"{target:.1f}",
                    f"{landed:.3f}",
                    f"{size / 1e6:.4f}",
                    f"{len(ours.fit['rate_distortion']) - 1}",
                    f"{seconds:.0f}",
                    f"{len(others)}",
                    f"{rounded.rounded / 1e6:.4f}",
                    f"{size / rounded.rounded:.3f}",
                    f"{saved.saved / 1e6:.4f}",
                    f"{size / saved.saved:.3f}",
                ]
            )
            about = f"{name}, {method}, {target:g} dB"
            bars.append(bar(target <= landed <= target + 0.1, f"{about}: lands at {landed:.3f} dB"))
            bars.append(
                bar(
                    size <= LARGER * rounded.rounded,
                    f"{about}: {size / rounded.rounded:.3f} of the grid's smallest file, "
                    f"{_settings(rounded.settings)}",
                )
            )
            _plot(OUT / f"rate_distortion_{name}_{method}.png", about, ours, others)
    print(table(rows))
    print("\n".join(bars))


def _middle(dataset: Dataset) -> float:
    """The quality of an N-SVD of the usual ranks."""
    ranks = {mode: min(_MIDDLE[mode], size) for mode, size in mode_sizes(dataset).items()}
    return compress(dataset, "nsvd", ranks=ranks).fit["snr_db"]


def _grid(dataset: Dataset, method: str, target: float, folder: Path) -> Iterator[Found]:
    """Every setting that reaches a target, as far as it may be the best."""
    best = None
    for numbers, settings in sorted(_candidates(dataset, method, target), key=lambda one: one[0]):
        if best is not None and numbers > _MORE_NUMBERS * best.numbers:
            return
        model = compress(dataset, method, **settings)
        error = model.fit["errors"][-1]
        spare = 10.0 ** (-target / 10.0) / error - 1.0
        if spare < 0.0:
            continue
        squared = error * _energy(dataset)
        rounded = round_model(model, squared, min(max(spare, SHARE), MOST))
        found = Found(
            settings,
            model.fit["snr_db"],
            numbers,
            saved_bytes(model, folder),
            saved_bytes(rounded, folder),
        )
        if best is None or found.rounded < best.rounded:
            best = found
        yield found


def _candidates(
    dataset: Dataset, method: str, target: float
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Numbers and settings of all that may reach a target."""
    sizes = mode_sizes(dataset)
    largest = {mode: min(_LARGEST[mode], sizes[mode]) for mode in sizes}
    if method == "nsvd":
        yield from _truncated(dataset, compress(dataset, method, ranks=largest), target, {})
        return
    for clusters, mixtures in itertools.product(_CLUSTERS, _MIXTURES):
        clustering = {"clusters": {"view": clusters}, "mixtures": {"view": mixtures}}
        model = compress(dataset, method, ranks={**largest, "view": RANK}, **clustering)
        yield from _truncated(dataset, model, target, clustering)


def _truncated(
    dataset: Dataset, model: ClusteredTucker, target: float, clustering: dict[str, Any]
) -> Iterator[tuple[int, dict[str, Any]]]:
    """The truncations of one fit that may reach a target when they are fitted."""
    found = truncations(model, model.fit["errors"][-1] * _energy(dataset))
    allowed = _energy(dataset) * 10.0 ** (-target / 10.0)
    steps = [[rank for rank in choices if rank % 4 == 0] for choices in found.ranks.values()]
    for chosen in itertools.product(*steps):
        ranks = {mode: int(rank) for mode, rank in zip(found.ranks, chosen, strict=True)}
        if ranks["y"] == ranks["x"] and found.error_at(ranks, _REGAINED) <= allowed:
            yield found.numbers_at(ranks), {"ranks": ranks, **clustering}


@cache
def _energy(dataset: Dataset) -> float:
    """sum A^2."""
    return sum(float(np.square(part, dtype=float).sum()) for part in dataset.samples)


def _settings(settings: dict[str, Any]) -> str:
    ranks = "x".join(str(rank) for rank in settings["ranks"].values())
    if "clusters" not in settings:
        return ranks
    return f"{ranks}, C {settings['clusters']['view']}, K {settings['mixtures']['view']}"


def _plot(path: Path, title: str, ours: ClusteredTucker, others: list[Found]) -> None:
    """The grid, the curve that was walked and where it ended."""
    walked = ours.fit["rate_distortion"]
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(4.6, 3.4), layout="constrained")
        axes.plot(
            [one.saved / 1e6 for one in others],
            [one.snr_db for one in others],
            ".",
            color="#bbbbbb",
            label="grid, as saved",
        )
        axes.plot(
            [one.rounded / 1e6 for one in others],
            [ours.fit["target"]["snr_db"]] * len(others),
            "|",
            color="#777777",
            label="grid, rounded to the target",
        )
        axes.plot(
            [point["bytes"] / 1e6 for point in walked],
            [point["snr_db"] for point in walked],
            "o",
            color=COLOURS[0],
            label="walked",
        )
        landed = next(point for point in walked if point["snr_db"] == round(ours.fit["snr_db"], 3))
        axes.plot(
            landed["bytes"] / 1e6, landed["snr_db"], "*", ms=11, color=COLOURS[1], label="landed"
        )
        axes.set(title=title, xlabel="file (MB)", ylabel="SNR (dB)", xscale="log")
        axes.legend(fontsize=7)
        _save(figure, path)


if __name__ == "__main__":
    main()
