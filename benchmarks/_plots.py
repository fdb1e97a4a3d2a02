"""Plots and pictures of the benchmarks, in one style."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray

matplotlib.use("Agg")  # no window
import matplotlib.pyplot as plt  # noqa: E402

# Wong's colours tell apart for colour-blind eyes; markers do in print.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
MARKERS = ("o", "s", "^", "D", "v", "P")
STYLE = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.5,
    "legend.frameon": False,
    "savefig.dpi": 120,
}


@dataclass(frozen=True)
class Line:
    """One line of a plot."""

    label: str
    x: Sequence[float]
    y: Sequence[float]


def line_plot(
    path: Path,
    lines: Sequence[Line],
    *,
    title: str,
    x: str,
    y: str = "SNR (dB)",
    whole_numbers: bool = False,
    at: tuple[float, str] | None = None,
) -> None:
    """Save lines as a PNG. at: an upright line at x, and what it says."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(4.6, 3.4), layout="constrained")
        for number, line in enumerate(lines):
            axes.plot(
                line.x,
                line.y,
                color=COLOURS[number % len(COLOURS)],
                marker=MARKERS[number % len(MARKERS)],
                label=line.label,
            )
        if at:
            axes.axvline(at[0], color="#888888", linewidth=0.9, linestyle="--")
            axes.annotate(
                at[1],
                (at[0], 0.02),
                xycoords=("data", "axes fraction"),
                xytext=(3, 0),
                textcoords="offset points",
                color="#666666",
                fontsize=8,
            )
        if whole_numbers:
            axes.xaxis.get_major_locator().set_params(integer=True)
        axes.set(title=title, xlabel=x, ylabel=y)
        if len(lines) > 1:
            axes.legend()
        _save(figure, path)


def difference_images(
    path: Path,
    raw: NDArray[np.floating],
    approximations: Sequence[tuple[str, NDArray[np.floating]]],
    *,
    title: str,
    factor: float,
) -> None:
    """Save images (y, x, channel), linear and y upward, above their absolute differences.

    All have the raw image's exposure; differences are scaled by `factor`.
    """
    white = max(float(np.percentile(raw, 99.5)), 1e-6)
    with plt.rc_context({**STYLE, "axes.grid": False}):
        columns = 1 + len(approximations)
        figure, axes = plt.subplots(
            2, columns, figsize=(1.9 * columns, 4.5), layout="constrained", squeeze=False
        )
        for column, (label, image) in enumerate([("raw data", raw), *approximations]):
            shown = (image, factor * np.abs(image - raw))
            for row, picture in enumerate(shown):
                axis = axes[row, column]
                axis.set_axis_off()
                if row == 0:
                    axis.set_title(label, fontsize=8)
                if row == 1 and column == 0:
                    axis.text(0.5, 0.5, f"absolute\ndifference,\nscaled by {factor:g}", ha="center")
                    axis.set(xlim=(0, 1), ylim=(0, 1))
                    continue
                axis.imshow(_display(picture / white), origin="lower", interpolation="nearest")
        figure.suptitle(title, fontsize=10)
        _save(figure, path)


def _display(linear: NDArray[np.floating]) -> NDArray[np.floating]:
    """Linear Rec.709 as sRGB, clipped."""
    clipped = np.clip(linear, 0.0, 1.0)
    low = 12.92 * clipped
    return np.where(clipped <= 0.0031308, low, 1.055 * clipped ** (1 / 2.4) - 0.055)


def _save(figure: plt.Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
    plt.close(figure)
    print(f"  {path.name}")
