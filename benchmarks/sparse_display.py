"""Sparse models in the GLSL engine: interpolation in coefficient space against image space, and
what the number of coefficients costs.

In coefficient space (SparseBTF, Eq. 6) the rows of light and view are filtered; in image space the
3 x 3 measured neighbours of light and view are decoded whole and their colours mixed, as the paper
does without Eq. 6 (with 2 x 2). A plane fills the picture under suns without shadows; frames are
drawn in turn, medians of ratios. Fetches are counted by the shaders themselves. Nothing depends on
what is learned from what: the wool is coded by the dictionaries that Nacre comes with.
`python -m benchmarks.sparse_display`
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median

import numpy as np

from addon.models.sparse.model import SparseBtf
from addon.preview.context import need_gpu
from addon.preview.textures import laid_out
from addon.tables.sparse_tables import build_sparse_tables

from . import nodes
from ._glsl import Screen
from ._image_space import ImageSpace
from ._report import bar, table
from ._sparse_sets import wool
from .glsl import engine_frame

AT_LEAST = 3.0
"""Times that coefficient space is faster; the paper has 4."""

# Mesa's llvmpipe ends a shader after 65,535 rounds of its loops: in image space no more fits.
COMPARED = ((16, 1), (16, 4), (64, 1), (64, 2), (128, 1))
STEPS = (1, 4, 16, 32, 64, 128, 256)
AGAINST_PRINCIPLED = (16, 64)
SIZE = (96, 72)
SCENE = (320, 240)
REPEATS = 5


def main() -> None:
    need_gpu()
    whole = wool()
    print(f"wool, {whole.height} x {whole.width} texels, {len(whole.ensemble.light)} directions")
    interpolation(whole)
    by_coefficients(whole)


@dataclass(frozen=True)
class Compared:
    """Fetches a pixel; over coefficient space, the median of a frame's seconds; and how far from
    its the picture is, over the mean."""

    fetches: int
    ratio: float
    apart: float


def interpolation(whole: SparseBtf) -> None:
    rows = [["Against coefficient space", "lights", "fetches", "whole", "views once",
             "slower: whole", "views once", "apart"]]  # fmt: skip
    worst = float("inf")
    for quality, suns in COMPARED:
        lower = whole.truncated(quality)
        ours, decoded, shared = compare(
            Screen(laid_out(build_sparse_tables(lower)), SIZE, suns),
            ImageSpace(lower, SIZE, suns),
            ImageSpace(lower, SIZE, suns, shared=True),
        )
        fetches = [str(one.fetches) for one in (ours, decoded, shared)]
        ratios = [f"{one.ratio:.1f}" for one in (decoded, shared)]
        rows.append([f"SparseBTF({quality})", str(suns), *fetches, *ratios, f"{decoded.apart:.1%}"])
        worst = min(worst, decoded.ratio)
    print(table(rows))
    print(bar(worst >= AT_LEAST, f"coefficient space is {worst:.1f} times faster at least"))


def compare(*screens: Screen) -> list[Compared]:
    """The first screen, and others over it; in turn, so that what else the machine does slows
    all."""
    draws = [screen.engine() for screen in screens]
    fetches = [int(screen.pixels(screen.counted()).max()) for screen in screens]
    pairs = list(zip(screens, draws, strict=True))
    pictures = [screen.pixels(draw)[..., :3] for screen, draw in pairs]
    times = [[screen.seconds(draw) for screen, draw in pairs] for _ in range(REPEATS)]
    return [
        Compared(
            fetches[number],
            median(row[number] / row[0] for row in times),
            float(np.abs(picture - pictures[0]).mean() / pictures[0].mean()),
        )
        for number, picture in enumerate(pictures)
    ]


def by_coefficients(whole: SparseBtf) -> None:
    """The engine's shortest frame, and over EEVEE's of a Principled BSDF."""
    rows = [["One light", "coefficients", "fetches", "{}x{}, ms".format(*SIZE),
             "{}x{}, to Principled".format(*SCENE), "MB"]]  # fmt: skip
    with nodes.lit_plane(SCENE, 1) as (scene, _):
        for quality in STEPS:
            lower = whole.truncated(quality)
            layout = laid_out(build_sparse_tables(lower))
            screen = Screen(layout, SIZE, 1)
            draw = screen.engine()
            fetches = int(screen.pixels(screen.counted()).max())
            screen.seconds(draw)
            taken = min(screen.seconds(draw) for _ in range(REPEATS))
            ratio = ""
            if quality in AGAINST_PRINCIPLED:
                ratio = f"{engine_frame(scene, layout, SCENE) / nodes.frame(scene):.2f}"
            counts = sum(lower.sparsity.values())
            size = f"{screen.textures.bytes / 1e6:.1f}"
            rows.append(
                [f"SparseBTF({quality})", str(counts), str(fetches), f"{1e3 * taken:.0f}", ratio,
                 size]
            )  # fmt: skip
    print(table(rows))


if __name__ == "__main__":
    main()
