"""How noisy pictures are, from a few of them rendered twice with different seeds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np

# Samples that a noise target is tried out with: from how many on, and up to how many.
FEWEST, MOST = 4, 4096


def strips_rendered_twice(lights: int, rows: int) -> list[tuple[int, int]]:
    """(light, row of tiles) of what is rendered a second time: each row once, as many lights as
    there are, both from the normal to the horizon and independent of each other.

    All together they cost as much as one picture.
    """
    chosen = np.linspace(0, lights - 1, rows).round().astype(int).tolist()
    order = np.random.default_rng(0).permutation(rows).tolist()
    return list(zip(chosen, order, strict=True))


def energy_and_noise(values: np.ndarray, again: np.ndarray) -> np.ndarray:
    """(2,) float64: the energy of samples, and that of their noise, from others of another seed."""
    energy = np.square(values, dtype=np.float64).sum()
    noise = np.square(values - again, dtype=np.float64).sum() / 2
    return np.array([energy, noise])


def noise_floor_db(found: Iterable[np.ndarray]) -> float | None:
    """Energy over noise in decibels, of what `energy_and_noise` found; None without noise."""
    energy, noise = np.sum([np.zeros(2), *found], axis=0)
    if not (energy > 0 and noise > 0):
        return None
    return round(10 * math.log10(energy / noise), 2)


def samples_for(target_db: float, noise: Callable[[int], float | None]) -> int:
    """The fewest samples a texel, about, whose noise floor is at least `target_db`.

    `noise(samples)` is the noise floor with so many. Noise falls by 3 dB or more whenever samples
    double, so each trial says how many to try next.
    """
    samples = FEWEST
    while samples < MOST:
        floor = noise(samples)
        if floor is None or floor >= target_db:
            break
        # No further than to four times as many: the estimate is rough.
        lacking = min(max(target_db - floor, 0.5), 6.0)
        samples = min(MOST, math.ceil(samples * 10 ** (lacking / 10)))
    return samples
