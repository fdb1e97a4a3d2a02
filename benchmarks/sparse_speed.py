"""How fast sparse codes are trained and found, against what the machine can do.

Coding projects each patch on all dictionaries (Eq. 3): 2 * values * (sum of the modes' rows)
operations for each; choosing the largest coefficients is extra and not counted. Training projects a
patch K + 3 times a sweep where dictionaries are chosen anew and 4 times where not, and adds up the
Procrustes problems, which are not counted. The least time is operations over the rate of
single-precision products, or bytes (a patch read as half floats, four mode products that each read
and write it) over the memory's bandwidth, whichever is longer; both are measured in the same run.

    python -m benchmarks.sparse_speed [--patches 8]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import nacre_native
import numpy as np
from numpy.typing import NDArray

from . import _machine
from ._report import table

ANGLES = 151
SIDE = 10
SPARSITY = 256
PAPER_PATCHES, PAPER_SWEEPS = 2880, 30


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.sparse_speed", description=__doc__)
    parser.add_argument("--patches", type=int, default=8)
    options = parser.parse_args()
    products, moved = _machine.report()
    shape = (SIDE, SIDE, ANGLES, ANGLES)
    patches = _patches(options.patches, shape)
    rows = []
    for dictionaries in (2, 4, 8):
        ensemble = _ensemble(dictionaries, shape)
        seconds = _best(lambda e=ensemble: nacre_native.code_patches(patches, e, SPARSITY))
        rows.append(_row(f"coding, K {dictionaries}", len(patches) * dictionaries, seconds,
                         products, moved))  # fmt: skip
        whole = seconds / len(patches) * 3 * 1600
        print(f"K {dictionaries}: a BTF of 400 x 400 texels, 3 channels: {whole:.0f} s "
              "(paper, K 8: 1060 s)")  # fmt: skip
    sweeps = {}
    for count, dictionaries in ((1, 2), (1, 4), (1, 8), (2, 4)):
        some = np.concatenate([patches] * count) if count > 1 else patches
        # The difference of two trainings: what is done once, for the start, is not a sweep.
        once, thrice = (
            _best(
                lambda n=n, s=some, k=dictionaries: nacre_native.fit_ensemble(
                    s, dictionaries=k, sparsity=SPARSITY, sweeps=n, tolerance=0.0
                ),
                2,
            )
            for n in (1, 3)
        )
        seconds = (thrice - once) / 2
        sweeps[len(some), dictionaries] = seconds
        rows.append(_row(f"sweep, K {dictionaries}, {len(some)} patches",
                         len(some) * (dictionaries + 3), seconds, products, moved))  # fmt: skip
    print(table([["work", "GFLOP", "seconds", "GFLOP/s", "share of the bound"], *rows]))
    per_patch = sweeps[len(patches), 8] / len(patches)
    hours = per_patch * 3 * PAPER_PATCHES * PAPER_SWEEPS / 3600
    print(f"estimate for the paper's set, {PAPER_PATCHES} patches, K 8, 3 channels: "
          f"{per_patch * 3 * PAPER_PATCHES:.0f} s a sweep, {hours:.1f} h for {PAPER_SWEEPS} sweeps "
          "(paper: 101 h on 128 cores)")  # fmt: skip


def _patches(count: int, shape: tuple[int, ...]) -> NDArray[np.float16]:
    """Noise whose variance falls along light and view, as a BTF's does in its bases."""
    random = np.random.default_rng(0)
    values = random.standard_normal((count, *shape), np.float32)
    fall = (1 / np.sqrt(np.arange(1, ANGLES + 1))).astype(np.float32)
    return np.asarray(values * fall[:, None] * fall, np.float16)


def _ensemble(count: int, shape: tuple[int, ...]) -> tuple[NDArray[np.float32], ...]:
    random = np.random.default_rng(1)
    return tuple(
        np.linalg.qr(random.standard_normal((count, size, size)))[0].astype(np.float32)
        for size in shape
    )


def _best(work: Callable[[], object], repeats: int = 3) -> float:
    best = float("inf")
    for _ in range(repeats):
        started = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - started)
    return best


def _row(name: str, projections: int, seconds: float, products: float, moved: float) -> list[str]:
    values = SIDE * SIDE * ANGLES * ANGLES
    operations = projections * 2 * values * 2 * (SIDE + ANGLES)
    # Halves are read once; of four mode products each reads and writes all values.
    data = projections * values * 4 * 2 * 4
    least = max(operations / products, data / moved)
    return [name, f"{operations / 1e9:.1f}", f"{seconds:.2f}", f"{operations / seconds / 1e9:.0f}",
            f"{least / seconds:.0%}"]  # fmt: skip


if __name__ == "__main__":
    main()
