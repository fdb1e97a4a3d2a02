"""One thread against all of this machine's, K-CTA and MK-CTA at paper size (81x81x128x128 RGB).

K-CTA has Corduroy's parameters. The bar on two cores: 1.7 times as fast. Both do the same
iterations and give the same bits. Runs alternate; the shortest of each counts. A matrix product
alone is measured the same way: no fit can scale better where cores share clock or memory.
"""

from __future__ import annotations

import tempfile
import time

from . import _machine
from ._fits import CORDUROY_KCTA, Settings, native
from ._materials import patchwork

ITERATIONS = {"K-CTA": 8, "MK-CTA": 4}
ROUNDS = 4  # of which the shortest counts
MKCTA = Settings((4, 4, 80, 80), {0: 8, 1: 10}, {0: 2, 1: 2}, (2, 3))


def main() -> None:
    several = _machine.threads()
    products = _machine.sgemm_rate(several) / _machine.sgemm_rate(1)
    moved = _machine.bandwidth(several) / _machine.bandwidth(1)
    print(f"{several} threads against 1: sgemm {products:.2f}, memory bandwidth {moved:.2f}")
    with tempfile.TemporaryDirectory() as folder:
        dataset = patchwork(folder, 128)
        for name, settings in (("K-CTA", CORDUROY_KCTA), ("MK-CTA", MKCTA)):
            best: dict[int, float] = {}
            errors: dict[int, list[float]] = {}
            for _ in range(ROUNDS):
                for threads in (1, several):
                    started = time.perf_counter()
                    result = native(dataset, settings, ITERATIONS[name], 0.0, threads)
                    seconds = time.perf_counter() - started
                    best[threads] = min(best.get(threads, seconds), seconds)
                    errors[threads] = result["errors"]
            print(
                f"{name} {settings}, {ITERATIONS[name]} iterations: {best[1]:.2f} s and "
                f"{best[several]:.2f} s, ratio {best[1] / best[several]:.2f}, "
                f"{'same' if errors[1] == errors[several] else 'DIFFERENT'} errors"
            )


if __name__ == "__main__":
    main()
