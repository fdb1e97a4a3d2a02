"""Time of a fit against the number of samples: 81x81 RGB images of four sizes over a factor of 16,
the same ranks and iterations. The bar: it grows linearly.

A straight line is fitted to the shortest of three runs at each size; R^2 says how much of the
variation it explains, and the last column how far each size is from it.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np

from ._fits import Settings, native
from ._materials import patchwork

SIZES = (32, 51, 81, 128)
ITERATIONS = 6
FITS = {
    "K-CTA": Settings((20, 4, 16, 16), {1: 7}, {1: 3}, (0,)),
    "MK-CTA": Settings((4, 4, 16, 16), {0: 8, 1: 10}, {0: 2, 1: 2}, (2, 3)),
}


def main() -> None:
    samples = np.array([81 * 81 * 3 * size**2 for size in SIZES])
    seconds: dict[str, list[float]] = {name: [] for name in FITS}
    with tempfile.TemporaryDirectory() as folder:
        for size in SIZES:
            inside = Path(folder) / str(size)
            inside.mkdir()
            dataset = patchwork(inside, size)
            for name, settings in FITS.items():
                runs = []
                for _ in range(3):
                    started = time.perf_counter()
                    native(dataset, settings, ITERATIONS, 0.0)
                    runs.append(time.perf_counter() - started)
                seconds[name].append(min(runs))
    for name, found in seconds.items():
        slope, start = np.polyfit(samples, found, 1)
        line = start + slope * samples
        left = np.sum((found - line) ** 2) / np.sum((found - np.mean(found)) ** 2)
        print(f"{name} {FITS[name]}, {ITERATIONS} iterations: ", end="")
        print(f"{1e9 * slope:.2f} s for 10^9 samples and {start:.2f} s, R^2 {1 - left:.4f}")
        for size, count, measured, fitted in zip(SIZES, samples, found, line, strict=True):
            print(
                f"  81x81x{size}x{size}x3 {count / 1e6:7.1f} M {measured:7.3f} s "
                f"{measured / fitted - 1:+7.1%}"
            )


if __name__ == "__main__":
    main()
