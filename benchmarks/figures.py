"""The MK-CTA paper's Figure 5 on our glossiest BTF, and SNR by iteration on all, as plots.

(a) SNR against the clusters of the view mode, (b) against the mixture clusters, (c) against size
for N-SVD, K-CTA and MK-CTA. `python -m benchmarks.figures [FOLDER] [--only NAME ...]` writes them
to out/bench.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from addon.datasets.dataset import Dataset

from ._data import OUT, arguments, glossiest, materials
from ._methods import Settings, fit
from ._papers import KCTA, MKCTA, kcta_settings, like_kcta, like_mkcta, mkcta_settings
from ._plots import Line, line_plot
from ._report import bar, table

VIEW_CLUSTERS = (4, 8, 12, 16, 20)
MIXTURES = (1, 2, 3, 4)
PAPER_ITERATIONS = 6
"""Within so many iterations MK-CTA often converges (Tsai 2015, Section 5.4)."""

SETTLED = 0.1
"""What iterations beyond those may still add, in dB."""


def main() -> None:
    options = arguments("figures", __doc__)
    found = materials(options.folder, options.only)
    name = glossiest(found)
    dataset = found[name]
    *_, kcta, mkcta = mkcta_settings(dataset, MKCTA[like_mkcta(name)])
    view_clusters(name, dataset, mkcta)
    mixtures(name, dataset, mkcta)
    sizes(name, dataset, kcta, mkcta)
    kcta_clusters(found)
    iterations(found)


def view_clusters(name: str, dataset: Dataset, settings: Settings) -> None:
    """Figure 5(a): SNR against the number of view clusters."""
    print(f"\nFigure 5(a), {name}: MK-CTA, {_text(settings)} but for C_v")
    light = settings.clusters[0]
    snr = [fit(dataset, replace(settings, clusters=(light, view))).snr for view in VIEW_CLUSTERS]
    _print("C_v", VIEW_CLUSTERS, snr)
    steps = [after - before for before, after in pairwise(snr)]
    print(bar(min(steps) > 0, f"SNR rises with C_v, by {min(steps):.2f} dB or more a step"))
    line_plot(
        OUT / "mkcta_view_clusters.png",
        [Line("MK-CTA", VIEW_CLUSTERS, snr)],
        title=f"{name}: MK-CTA, C_l {light}, K {settings.mixtures[0]}x{settings.mixtures[1]}",
        x="clusters of the view mode",
    )


def mixtures(name: str, dataset: Dataset, settings: Settings) -> None:
    """Figure 5(b): SNR against the mixture clusters, for several numbers of view clusters."""
    print(f"\nFigure 5(b), {name}: MK-CTA, {_text(settings)} but for C_v and K")
    light, view = settings.clusters
    lines = []
    for count in (view // 3, 2 * view // 3, view):
        possible = [k for k in MIXTURES if k <= min(light, count)]
        snr = [
            fit(dataset, replace(settings, clusters=(light, count), mixtures=(k, k))).snr
            for k in possible
        ]
        _print(f"C_v {count}, K", possible, snr)
        lines.append(Line(f"C {light}x{count}", possible, snr))
    print(_saturates(lines[-1]))
    line_plot(
        OUT / "mkcta_mixtures.png",
        lines,
        title=f"{name}: MK-CTA",
        x="mixture clusters K of both modes",
        whole_numbers=True,
    )


def sizes(name: str, dataset: Dataset, kcta: Settings, mkcta: Settings) -> None:
    """Figure 5(c): SNR against size for the three models, each with more and more for the views."""
    print(f"\nFigure 5(c), {name}: SNR against size")
    views = dataset.shape[1]
    series: dict[str, list[Settings]] = {"N-SVD": [], "K-CTA": [], "MK-CTA": []}
    for view in VIEW_CLUSTERS:
        light_rank, view_rank, y, x = kcta.ranks
        series["N-SVD"].append(Settings((light_rank, min(view_rank * view, views), y, x)))
        series["K-CTA"].append(replace(kcta, clusters=(1, view)))
        series["MK-CTA"].append(replace(mkcta, clusters=(mkcta.clusters[0], view)))
    lines = []
    for label, these in series.items():
        found = [fit(dataset, setting) for setting in these]
        lines.append(Line(label, [one.mb for one in found], [one.snr for one in found]))
        _print(f"{label}, MB", [round(one.mb, 2) for one in found], lines[-1].y)
    above = [mk - k for mk, k in zip(lines[2].y, lines[1].y, strict=True)]
    print(bar(min(above) > 0, f"MK-CTA above K-CTA at every size, by {min(above):.2f} dB or more"))
    line_plot(
        OUT / "mkcta_sizes.png", lines, title=name, x="approximated data (MB, unpacked half floats)"
    )


def kcta_clusters(found: dict[str, Dataset]) -> None:
    """K-CTA's Figure 5(a): SNR against the total rank of the view mode, for 1 to 4 mixtures."""
    name = "roughhole" if "roughhole" in found else next(iter(found))
    dataset = found[name]
    nsvd, _, settings = kcta_settings(dataset, KCTA[like_kcta(name)])
    print(f"\nK-CTA's Figure 5(a), {name}: {_text(settings)} but for C_v and K_v")
    rank = settings.ranks[1]
    counts = sorted({*VIEW_CLUSTERS, settings.clusters[1]})
    lines = []
    for k in MIXTURES:
        snr = [
            fit(dataset, replace(settings, clusters=(1, count), mixtures=(1, k))).snr
            for count in counts
        ]
        _print(f"K {k}, R_v C", [rank * count for count in counts], snr)
        label = f"K-CTA ({k})" if k > 1 else "CTA"
        lines.append(Line(label, [rank * count for count in counts], snr))
    ranks = [rank * count for count in counts if rank * count <= dataset.shape[1]]
    light, _, y, x = nsvd.ranks
    snr = [fit(dataset, Settings((light, view, y, x))).snr for view in ranks]
    _print("N-SVD, R_v", ranks, snr)
    steps = [after - before for line in lines for before, after in pairwise(line.y)]
    print(bar(min(steps) > 0, f"SNR rises with C_v, by {min(steps):.2f} dB or more a step"))
    at = Line("", MIXTURES, [line.y[line.x.index(rank * settings.clusters[1])] for line in lines])
    print(_saturates(at))
    line_plot(
        OUT / "kcta_view_rank.png",
        [Line("N-SVD", ranks, snr), *lines],
        title=name,
        x="rank of the view mode, all clusters together",
    )


def iterations(found: dict[str, Dataset]) -> None:
    """SNR by iteration of MK-CTA on each material."""
    print("\nSNR by iteration, MK-CTA at the settings of the paper's Table I; 0 is the first guess")
    lines = []
    for name, dataset in found.items():
        snr = fit(dataset, mkcta_settings(dataset, MKCTA[like_mkcta(name)])[3]).by_iteration
        lines.append(Line(name, range(len(snr)), snr))
        _print(name, range(len(snr)), snr)
        later = snr[-1] - snr[min(PAPER_ITERATIONS, len(snr) - 1)]
        print(
            bar(
                later <= SETTLED,
                f"{name}: iterations beyond {PAPER_ITERATIONS} add {later:.3f} dB, "
                f"at most {SETTLED:g}",
            )
        )
    line_plot(
        OUT / "mkcta_iterations.png",
        lines,
        title="MK-CTA",
        x="iterations",
        whole_numbers=True,
        at=(PAPER_ITERATIONS, "the paper: within 6"),
    )


def _saturates(line: Line) -> str:
    """The bar that a third and fourth mixture cluster add ever less than the second did."""
    gains = [after - before for before, after in pairwise(line.y)]
    steps = ", ".join(f"{k} to {k + 1} {gain:+.2f} dB" for k, gain in enumerate(gains, start=1))
    return bar(gains[-1] < gains[0] / 4, f"SNR saturates with K at 2 to 3: {steps}")


def _print(label: str, x: Sequence[float], y: Sequence[float]) -> None:
    print(table([[f"  {label}", *map(str, x)], ["  SNR (dB)", *(f"{value:.2f}" for value in y)]]))


def _text(settings: Settings) -> str:
    light, view, y, x = settings.ranks
    return (
        f"R {light}x{view}x{x}x{y}, C {settings.clusters[0]}x{settings.clusters[1]}, "
        f"K {settings.mixtures[0]}x{settings.mixtures[1]}"
    )


if __name__ == "__main__":
    main()
