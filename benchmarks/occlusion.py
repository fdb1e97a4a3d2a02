"""Error texels of occlusion textures: Table I, Figures 5(b) and 5(c) of K-CTA on rendered masks.

`python -m benchmarks.occlusion [FOLDER] [--only NAME ...]`; FOLDER holds NAME_mask.npy, which
`python -m benchmarks.recipes` writes; masks that are not there are rendered, in seconds.

Three encodings are fitted with the same ranks, and so have the same size: binary masks (B), the
paper's signed distances without end (S), and those that end near the boundary, which `compress`
fits (E). Counts hang on the first clusters: each is the mean over several seeds.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from addon.datasets.dataset import Dataset, DatasetWriter, open_dataset
from addon.datasets.occlusion import REACH, is_covered, signed_distance
from addon.models.fit import compress

from ._data import OUT, arguments
from ._plots import Line, line_plot
from ._report import MARK, bar, table

MATERIALS = ("fibre", "net")
TEXELS = 64
SEEDS = (0, 1, 2)
RANK, MIXTURES = 4, 3
METHODS = {"nsvd": "N-SVD", "cta": "CTA", "kcta": "K-CTA"}
ENCODINGS = {"B": "binary masks", "S": "signed distances", "E": f"distances to {REACH:g} texels"}

FEWER = 1.5
"""Of binary masks' error texels over signed distances', and of CTA's over K-CTA's."""

PAPER = {"Fiber": (80, 100), "RoughHole": (44, 100)}
"""The total view rank, R_v C, and the views of the paper's two occlusion textures."""
PAPER_TEXELS = {
    "Fiber": {"B": (732, 2222, 1046), "S": (71, 2027, 291)},
    "RoughHole": {"B": (572, 1938, 1029), "S": (325, 969, 597)},
}
"""Table I: error texels of N-SVD, CTA and K-CTA, of 100 views of 96 x 96 texels."""
PAPER_SHARE = 80 / 96
"""Of the spatial ranks in the texels."""

SHARES = (1 / 2, 2 / 3, PAPER_SHARE)
CLUSTERS = (4, 7, 10, 13, 16, 18)
CURVE_SHARE = 2 / 3


def main() -> None:
    options = arguments("occlusion", __doc__)
    for name in options.only or MATERIALS:
        dataset = masks(name, options.folder)
        paper_table(name, dataset)
        spatial_table(name, dataset)
        curves(name, dataset)


def masks(name: str, folder: Path | None) -> Dataset:
    """A recipe's masks at the 81 directions of the University of Bonn, as a dataset."""
    from addon.datasets.direction_sets import ubo_81

    view = ubo_81()
    path = folder / f"{name}_mask.npy" if folder else None
    samples = np.load(path) if path and path.is_file() else _render(name, view)
    description = {
        "nacre": 1,
        "kind": "occlusion",
        "axes": ["view", "y", "x"],
        "view": view.tolist(),
        "value": "mask",
        "patch_size": [0.01, 0.01],
        "periodic": True,
        "noise_floor_db": None,
        "source": {"format": "Cycles", "file": name, "conversions": []},
    }
    OUT.mkdir(parents=True, exist_ok=True)
    with DatasetWriter(OUT / f"{name}_mask.nacre", description, samples.shape, "f2") as writer:
        writer.write(samples)
    return open_dataset(OUT / f"{name}_mask.nacre")


def _render(name: str, view: NDArray[np.float64]) -> NDArray[np.float32]:
    import bpy

    from addon.measure.occlusion import measure_occlusion

    bpy.ops.wm.read_factory_settings(use_empty=True)
    recipe = importlib.import_module(f"benchmarks.recipes.{name}")
    return np.round(measure_occlusion(recipe.build(), view, texels=TEXELS))


def paper_table(name: str, dataset: Dataset) -> None:
    """Table I's rows of error texels, at the shares of the views and texels that the paper has."""
    views, height, width = dataset.shape
    print(f"\nTable I, {name}: error texels of {dataset.samples.size:,} ({width} x {height})")
    rows = [["", *METHODS.values(), "B/S", "CTA/K-CTA", MARK, "paper", *METHODS.values()]]
    for like, (rank, whole) in PAPER.items():
        clusters = round(rank / whole * views / RANK)
        settings = (clusters, _rank(height, PAPER_SHARE))
        found = {encoding: _each(dataset, encoding, settings) for encoding in ENCODINGS}
        size = _megabytes(dataset, settings)
        rows.append([f"C {clusters}, x,y {settings[1]}, {size:.2f} MB"])
        for encoding, counts in found.items():
            theirs = [f"{n:,}" for n in PAPER_TEXELS[like].get(encoding, ())]
            rows.append(
                [
                    f"  {encoding}  {ENCODINGS[encoding]}",
                    *(f"{count:,.0f}" for count in counts),
                    f"{_ratio(found['B'][2], counts[2]):.2f}" if encoding != "B" else "",
                    f"{_ratio(counts[1], counts[2]):.2f}",
                    MARK,
                    f"{like} {encoding}" if theirs else "",
                    *theirs,
                ]
            )
    print(table(rows))


def spatial_table(name: str, dataset: Dataset) -> None:
    """The same with K-CTA by spatial ranks, and the bars."""
    _, height, _ = dataset.shape
    rank, whole = PAPER["Fiber"]
    clusters = round(rank / whole * dataset.shape[0] / RANK)
    for share in SHARES:
        settings = (clusters, _rank(height, share))
        wrong = {encoding: error_texels(dataset, encoding, "kcta", settings) for encoding in "BSE"}
        cta = error_texels(dataset, "E", "cta", settings)
        where = f"{name}, C {clusters}, x,y {settings[1]}"
        for encoding in "SE":
            ratio = _ratio(wrong["B"], wrong[encoding])
            text = f"{where}: {ENCODINGS[encoding]} have {ratio:.2f} times fewer error texels"
            print(bar(ratio >= FEWER, f"{text} than masks ({FEWER} asked)"))
        ratio = _ratio(cta, wrong["E"])
        text = f"{where}: K-CTA has {ratio:.2f} times fewer error texels than CTA"
        print(bar(ratio >= FEWER, f"{text} ({FEWER} asked)"))


def curves(name: str, dataset: Dataset) -> None:
    """Figures 5(b), the methods on distances, and 5(c), the encodings in K-CTA."""
    spatial = _rank(dataset.shape[1], CURVE_SHARE)
    total = [RANK * clusters for clusters in CLUSTERS]

    def line(label: str, encoding: str, method: str) -> Line:
        counts = [error_texels(dataset, encoding, method, (c, spatial)) for c in CLUSTERS]
        return Line(label, total, counts)

    methods = [line(label, "E", method) for method, label in METHODS.items()]
    encodings = [line(label, encoding, "kcta") for encoding, label in ENCODINGS.items()]
    print(f"\nFigures 5(b) and 5(c), {name}: error texels against R_v C, x,y {spatial}")
    print(table([["", *map(str, total)], *map(_row, [*methods, *encodings])]))
    binary, *distances = encodings
    for distance in distances:
        cross = crossing(total, binary.y, distance.y)
        found = f"R_v C = {cross:.0f}" if cross else f"no R_v C up to {total[-1]}"
        print(f"  {distance.label} have fewer than binary masks from {found} (the paper: 36)")
    cross = crossing(total, binary.y, distances[-1].y)
    for part, lines, at in (("methods", methods, None), ("crossing", encodings, cross)):
        line_plot(
            OUT / f"occlusion_{part}_{name}.png",
            [replace(each, y=np.maximum(each.y, 1.0)) for each in lines],
            title=f"{name}: {ENCODINGS['E'] if part == 'methods' else 'K-CTA, K 3'}, x,y {spatial}",
            x="total view rank, R_v C",
            y="error texels",
            at=(at, f"crossing point {at:.0f}") if at else None,
        )


def crossing(x: Sequence[float], above: Sequence[float], below: Sequence[float]) -> float | None:
    """Where the second line falls below the first for good, by interpolation; None if it does not.

    The first x where it is below everywhere.
    """
    gap = np.subtract(above, below)
    wrong = np.flatnonzero(gap <= 0)
    if not len(wrong):
        return float(x[0])
    last = int(wrong[-1])
    if last == len(gap) - 1:
        return None
    share = -gap[last] / (gap[last + 1] - gap[last])
    return float(x[last] + share * (x[last + 1] - x[last]))


@cache
def error_texels(dataset: Dataset, encoding: str, method: str, settings: tuple[int, int]) -> float:
    """Texels whose visibility a model gets wrong, the mean over seeds; settings (C, R_x = R_y)."""
    clusters, spatial = settings
    covered = is_covered(dataset.samples, "mask")
    fitted = _encoded(dataset, encoding)
    rank = RANK if method != "nsvd" else min(RANK * clusters, dataset.shape[0])
    counts = []
    for seed in SEEDS if method != "nsvd" else SEEDS[:1]:
        model = compress(
            fitted,
            method,
            ranks={"view": rank, "y": spatial, "x": spatial},
            clusters={"view": clusters} if method != "nsvd" else {},
            mixtures={"view": MIXTURES} if method == "kcta" else {},
            search="greedy" if method == "kcta" else "auto",  # the error never rises
            seed=seed,
        )
        counts.append(np.count_nonzero(is_covered(model.decode(), fitted.value) != covered))
    return float(np.mean(counts))


@cache
def _encoded(dataset: Dataset, encoding: str) -> Dataset:
    if encoding == "B":
        return dataset
    reach = np.inf if encoding == "S" else REACH
    samples = signed_distance(dataset.samples, dataset.periodic, reach)
    return replace(dataset, samples=samples, value="signed-distance")


def _each(dataset: Dataset, encoding: str, settings: tuple[int, int]) -> list[float]:
    return [error_texels(dataset, encoding, method, settings) for method in METHODS]


def _rank(texels: int, share: float) -> int:
    """A multiple of 4 (K-CTA, Section 6)."""
    return 4 * round(texels * share / 4)


def _megabytes(dataset: Dataset, settings: tuple[int, int]) -> float:
    """The papers' size of K-CTA: half floats, in MB of 2^20 bytes."""
    views, height, width = dataset.shape
    clusters, spatial = settings
    core = clusters * RANK * spatial**2
    return 2 * (core + views * MIXTURES * RANK + clusters * spatial * (height + width)) / 2**20


def _ratio(more: float, fewer: float) -> float:
    return more / max(fewer, 1.0)


def _row(line: Line) -> list[str]:
    return [line.label, *(f"{count:,.0f}" for count in line.y)]


if __name__ == "__main__":
    main()
