"""Random texels for one light and one view: MK-CTA and K-CTA against N-SVD of equal size.

All three are decoded by the same code: y and x expanded beforehand into a texel-major core, and
only the blocks of a light's and a view's mixture clusters read. What a texel costs is then in
proportion to K_light K_view R_light R_view. Parameters are those of the papers' Lego and Corduroy;
the numbers in the models are random, since their values do not change the time.
"""

from __future__ import annotations

import time
from math import prod
from typing import Any

import nacre_native
import numpy as np
from numpy.typing import NDArray

from addon.models.clustered_tucker import MODES, ClusteredTucker

TEXELS = 1 << 16
ROUNDS = 15
# Lights, views and texels of a side; then ranks, clusters and mixtures of each contender.
CASES: dict[str, dict[str, Any]] = {
    "Lego, MK-CTA": {
        "sizes": (120, 90, 128, 128),
        "N-SVD": {"ranks": (32, 48, 64, 64)},
        "MK-CTA": {
            "ranks": (4, 4, 64, 64),
            "clusters": {"light": 8, "view": 12},
            "mixtures": {"light": 3, "view": 3},
            "shared": ("y", "x"),
        },
        "at least": 5.0,
    },
    "Corduroy, K-CTA": {
        "sizes": (81, 81, 128, 128),
        "N-SVD": {"ranks": (20, 32, 80, 80)},
        "K-CTA": {
            "ranks": (20, 4, 80, 80),
            "clusters": {"view": 8},
            "mixtures": {"view": 3},
            "shared": ("light",),
        },
        "at least": 2.0,
    },
}


def main() -> None:
    print(
        "Core values read a texel, expanded core, time a texel on one thread and on all, how many"
    )
    print("times faster than N-SVD on one and on all, and by the values read alone")
    for name, case in CASES.items():
        print(f"{name}, at least {case['at least']:g} times N-SVD")
        contenders = {
            method: _random_model(case["sizes"], **case[method])
            for method in case
            if method in ("N-SVD", "K-CTA", "MK-CTA")
        }
        _report(contenders)


def _report(contenders: dict[str, ClusteredTucker]) -> None:
    """Print a line for each model; times are the best of rounds that take turns."""
    evaluators = {method: _evaluator(model) for method, model in contenders.items()}
    rng = np.random.default_rng(0)
    for method, model in contenders.items():
        _check(model, evaluators[method], rng)
    lights, views, height, width, _ = next(iter(contenders.values())).shape
    seconds = {(method, threads): np.inf for method in evaluators for threads in (1, 0)}
    for _ in range(ROUNDS):
        texels = rng.integers(0, height * width, TEXELS)
        light, view = int(rng.integers(lights)), int(rng.integers(views))
        for method, threads in seconds:
            started = time.perf_counter()
            evaluators[method].decode_texels(light, view, texels, threads=threads)
            took = time.perf_counter() - started
            seconds[method, threads] = min(seconds[method, threads], took)
    whole = evaluators["N-SVD"]
    for method, evaluator in evaluators.items():
        one, every = (1e9 * seconds[method, threads] / TEXELS for threads in (1, 0))
        ratios = [seconds["N-SVD", threads] / seconds[method, threads] for threads in (1, 0)]
        print(
            f"  {method:16}{evaluator.reads:>8}{evaluator.nbytes / 1e6:>7.0f} MB{one:>9.0f} ns"
            f"{every:>7.0f} ns{ratios[0]:>8.1f}, {ratios[1]:>4.1f} x"
            f"{whole.reads / evaluator.reads:>6.1f} x"
        )


def _check(
    model: ClusteredTucker, evaluator: nacre_native.Evaluator, rng: np.random.Generator
) -> None:
    """Stop unless the values are the decoder's."""
    lights, views, height, width, channels = model.shape
    light, view = int(rng.integers(lights)), int(rng.integers(views))
    expected = model.decode(light=[light], view=[view]).reshape(height * width, channels)
    seen = evaluator.decode_texels(light, view, np.arange(height * width))
    error = float(np.abs(seen - expected).max() / np.abs(expected).max())
    if not error < 1e-4:
        raise SystemExit(f"texels differ from the decoder's by {error:.2g} of the largest value")


def _evaluator(model: ClusteredTucker) -> nacre_native.Evaluator:
    return nacre_native.Evaluator(
        model.core,
        [model.bases[mode] for mode in MODES],
        {MODES.index(mode): members for mode, members in model.members.items()},
        {MODES.index(mode): count for mode, count in model.clusters.items()},
        channels=model.channels,
    )


def _random_model(
    sizes: tuple[int, int, int, int],
    ranks: tuple[int, int, int, int],
    clusters: dict[str, int] | None = None,
    mixtures: dict[str, int] | None = None,
    shared: tuple[str, ...] = (),
) -> ClusteredTucker:
    """A model of random numbers; `shared` names the modes whose basis is one for all clusters."""
    rng = np.random.default_rng(1)
    clusters, mixtures = clusters or {}, mixtures or {}
    bases: dict[str, NDArray[np.float32]] = {}
    members: dict[str, NDArray[np.uint32]] = {}
    for mode, size, rank in zip(MODES, sizes, ranks, strict=True):
        owners = prod(count for name, count in clusters.items() if name != mode)
        mixture = mixtures.get(mode, 1)
        rows = 3 * size if mode == "light" else size
        shape = (1 if mode in shared else owners, rows, mixture, rank)
        bases[mode] = rng.standard_normal(shape, np.float32)
        if mode in clusters:
            sets = [sorted(rng.permutation(clusters[mode])[:mixture]) for _ in range(size)]
            members[mode] = np.array(sets, np.uint32)
    core = rng.standard_normal((prod(clusters.values()), *ranks), np.float32)
    return ClusteredTucker(core, bases, members, clusters, {"channels": ["R", "G", "B"]})


if __name__ == "__main__":
    main()
