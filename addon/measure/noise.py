"""How noisy pictures are, from a few of them rendered twice with different seeds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np

# Lights that are rendered a second time. Each costs one picture of a measurement.
NOISE_LIGHTS = 4

# Lights that the number of samples for a noise target is tried out on, from how many on, and up to
# how many.
TRIAL_LIGHTS = 2
FEWEST, MOST = 4, 4096


def lights_rendered_twice(count: int) -> set[int]:
    """Which of `count` lights are rendered a second time: a few, from the normal to the horizon."""
    return set(np.linspace(0, count - 1, min(NOISE_LIGHTS, count)).round().astype(int).tolist())


def energy_and_noise(values: np.ndarray, again: np.ndarray) -> np.ndarray:
    """(2,) float64: the energy of a picture, and that of its noise, from a second picture."""
    energy = np.square(values, dtype=np.float64).sum()
    noise = np.square(values - again, dtype=np.float64).sum() / 2
    return np.array([energy, noise])


def noise_floor_db(found: Iterable[np.ndarray]) -> float | None:
    """Energy over noise in decibels, of what `energy_and_noise` found; None without noise."""
    energy, noise = np.sum([np.zeros(2), *found], axis=0)
    if not (energy > 0 and noise > 0):
        return None
    return round(10 * math.log10(energy / noise), 2)


def samples_for(target_db: float, render: Callable[[int, int, int], np.ndarray]) -> int:
    """The fewest samples a texel, about, whose noise floor is at least `target_db`.

    `render(light, samples, seed)` gives a picture of trial light 0 or 1. Noise falls by 3 dB or
    more whenever samples double, so each trial says how many to try next.
    """
    samples, best = FEWEST, MOST
    while samples < MOST:
        found = [
            energy_and_noise(render(light, samples, 0), render(light, samples, 1))
            for light in range(TRIAL_LIGHTS)
        ]
        floor = noise_floor_db(found)
        if floor is None or floor >= target_db:
            best = samples
            break
        # No further than to four times as many: the estimate is rough.
        lacking = min(max(target_db - floor, 0.5), 6.0)
        samples = min(MOST, math.ceil(samples * 10 ** (lacking / 10)))
    return best
