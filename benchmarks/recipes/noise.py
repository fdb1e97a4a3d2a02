"""Patterns on a unit square that repeat in x and y; all are (count, count) [y, x]."""

from __future__ import annotations

import numpy as np


def cell_distances(
    count: int, cells: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances to the nearest and second nearest of `cells` seeds, and the nearest's number."""
    seeds = random.uniform(size=(cells, 2))
    for _ in range(3):  # Lloyd's relaxation: cells of similar size
        numbers = _sorted_distances(96, seeds)[2]
        steps = (np.arange(96) + 0.5) / 96
        place = np.stack(np.meshgrid(steps, steps), -1)
        for i in range(cells):
            offset = (place[numbers == i] - seeds[i] + 0.5) % 1 - 0.5
            seeds[i] = (seeds[i] + offset.mean(0)) % 1
    return _sorted_distances(count, seeds)


def _sorted_distances(count: int, seeds: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    steps = (np.arange(count) + 0.5) / count
    around = [np.abs((steps[:, None] - seeds[:, axis] + 0.5) % 1 - 0.5) for axis in (0, 1)]
    distance = np.hypot(around[0][None], around[1][:, None])
    number = distance.argmin(-1)
    two = np.partition(distance, 1, -1)
    return two[..., 0], two[..., 1], number


def fractal(count: int, octaves: int, random: np.random.Generator) -> np.ndarray:
    """Fractal noise of standard deviation 0.5: white noise with a power-law spectrum."""
    wave = np.fft.fftfreq(count, 1 / count)
    radius = np.hypot(wave[:, None], wave[None])
    keep = (radius >= 2) & (radius < 2 ** (octaves + 1))
    gain = np.where(keep, 1 / np.maximum(radius, 1) ** 1.6, 0)
    pattern = np.fft.ifft2(np.fft.fft2(random.normal(size=(count, count))) * gain).real
    return 0.5 * pattern / pattern.std()
