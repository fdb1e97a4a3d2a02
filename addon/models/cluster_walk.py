"""Find the best numbers of clusters by trying few of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

STRIDES = (1.5, 1.2)
"""From one number to the next: first far, then near. The best is seldom sharp."""


def walk(
    merit: Callable[[dict[str, int]], float],
    start: Mapping[str, int],
    least: Mapping[str, int],
    most: Mapping[str, int],
    trials: int,
) -> dict[str, int]:
    """Numbers of clusters of each mode, `least` to `most`, where `merit` is lowest.

    One mode at a time goes up or down as long as that helps; `merit` is called once for each
    combination and at most `trials` times.
    """
    known: dict[tuple[int, ...], float] = {}

    def judged(clusters: Mapping[str, int]) -> float:
        key = tuple(clusters.values())
        if key not in known:
            known[key] = merit(dict(clusters)) if len(known) < trials else float("inf")
        return known[key]

    best = dict(start)
    judged(best)
    for stride in STRIDES:
        for mode in start:
            for factor in (stride, 1.0 / stride):
                begun = best
                while True:
                    moved = min(max(round(best[mode] * factor), least[mode]), most[mode])
                    if moved == best[mode]:  # small numbers have no part of themselves to go by
                        moved += 1 if factor > 1.0 else -1
                    tried = {**best, mode: moved}
                    if not least[mode] <= moved <= most[mode] or judged(tried) >= judged(best):
                        break
                    best = tried
                if best != begun:
                    break
    return best
