"""N-SVD against a float32 numpy version, on the measured wool (81x81x64x64 RGB).

Twice: the truncated HOSVD alone, and with alternating least squares to the compiled fit's stopping
rule, which numpy follows until its error is within 0.001 dB. The compiled fit starts from the half
floats of the dataset; numpy's time is given with and without the conversion of these to a float32
tensor (light rows, view, y, x). Runs alternate, each in a process of its own; the shortest of each
count. The bar: 1.5 times as fast, the conversion left out.

TensorLy's tucker (HOSVD and one sweep) and pyttb's sequentially truncated hosvd of the same tensor
are shown where they are installed. With `--quick` they are not run.
"""

from __future__ import annotations

import importlib.util
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nacre_native
import numpy as np

from addon.datasets.dataset import Dataset

from . import _machine, numpy_nsvd
from ._child import Measured, measured
from ._fits import decibels, opened
from ._materials import wool
from ._tensors import Array, squared_norm, tensor_of

RANKS = ((20, 28, 32, 32), (20, 32, 40, 40))
REPEATS = 4
EQUAL = 0.001  # dB
Ranks = tuple[int, ...]


def main() -> None:
    _machine.report()
    with tempfile.TemporaryDirectory() as folder:
        path = wool(folder).path
        for ranks in RANKS:
            print("\nranks " + "x".join(map(str, ranks)))
            _compare("truncated HOSVD", path, ranks, 0)
            _compare("to the stopping rule", path, ranks, 20)
            if "--quick" not in sys.argv:
                _show("tensorly", _tensorly, path, ranks)
                _show("pyttb", _pyttb, path, ranks)


def _compare(name: str, path: Path, ranks: Ranks, iterations: int) -> None:
    ours: list[Measured] = []
    theirs: list[Measured] = []
    for _ in range(REPEATS):
        ours.append(measured(opened, compiled, path, ranks, iterations))
        found = ours[0].value["db"]
        theirs.append(measured(opened, in_numpy, path, ranks, iterations, found - EQUAL))
    mine = min(run.value["fit"] for run in ours)
    fit = min(run.value["fit"] for run in theirs)
    whole = min(run.value["fit"] + run.value["conversion"] for run in theirs)
    first, second = ours[0].value, theirs[0].value
    off = second["db"] - first["db"]
    print(
        f"  {name}\n"
        f"    compiled {mine:7.3f} s {first['db']:9.4f} dB, {first['iterations']} iterations, "
        f"{max(run.peak for run in ours) / 1e6:.0f} MB\n"
        f"    numpy    {fit:7.3f} s {second['db']:9.4f} dB, {second['iterations']} iterations, "
        f"{max(run.peak for run in theirs) / 1e6:.0f} MB; with the conversion {whole:.3f} s\n"
        f"    ratio    {fit / mine:7.2f}, with the conversion {whole / mine:.2f}; "
        f"{'equal' if abs(off) <= EQUAL else 'NOT EQUAL'} to {EQUAL} dB ({off:+.4f})"
    )


def _show(name: str, job: Callable[..., Any], path: Path, ranks: Ranks) -> None:
    if importlib.util.find_spec(name) is None:
        print(f"  {name} is not installed")
        return
    value = measured(opened, job, path, ranks).value
    print(f"  {name:<10}{value['fit']:8.2f} s {value['db']:9.4f} dB   {value['what']}")


# Jobs for _child.measured, of (dataset, ranks, ...).


def compiled(prepared: tuple[Dataset, Ranks, int]) -> dict[str, Any]:
    dataset, ranks, iterations = prepared
    started = time.perf_counter()
    model = nacre_native.fit_nsvd(dataset.samples, ranks, iterations=iterations)
    return {
        "fit": time.perf_counter() - started,
        "db": decibels(model["errors"][-1]),
        "iterations": model["iterations"],
    }


def in_numpy(prepared: tuple[Dataset, Ranks, int, float]) -> dict[str, Any]:
    dataset, ranks, iterations, target = prepared
    tensor, energy, conversion = _converted(dataset)
    started = time.perf_counter()
    core, bases = numpy_nsvd.hosvd(tensor, ranks)
    done = 0
    while done < iterations and decibels(numpy_nsvd.error(core, energy)) < target:
        core = numpy_nsvd.sweep(tensor, bases)
        done += 1
    return {
        "fit": time.perf_counter() - started,
        "conversion": conversion,
        "db": decibels(numpy_nsvd.error(core, energy)),
        "iterations": done,
    }


def _converted(dataset: Dataset) -> tuple[Array, float, float]:
    """The tensor, its energy, and the seconds that the first took."""
    started = time.perf_counter()
    tensor = tensor_of(dataset.samples)
    seconds = time.perf_counter() - started
    return tensor, squared_norm(tensor), seconds


def _tensorly(prepared: tuple[Dataset, Ranks]) -> dict[str, Any]:
    import tensorly
    from tensorly.decomposition import tucker

    dataset, ranks = prepared
    tensor, energy, _ = _converted(dataset)
    started = time.perf_counter()
    core, _ = tucker(tensorly.tensor(tensor), rank=list(ranks), n_iter_max=1, tol=0)
    seconds = time.perf_counter() - started
    db = decibels(numpy_nsvd.error(np.asarray(core), energy))
    return {"fit": seconds, "db": db, "what": "tucker, n_iter_max 1"}


def _pyttb(prepared: tuple[Dataset, Ranks]) -> dict[str, Any]:
    import pyttb

    dataset, ranks = prepared
    tensor, energy, _ = _converted(dataset)
    held = pyttb.tensor(np.asfortranarray(tensor))
    started = time.perf_counter()
    found = pyttb.hosvd(held, tol=1.0, ranks=np.array(ranks), verbosity=0)
    seconds = time.perf_counter() - started
    core = np.ascontiguousarray(found.core.data, np.float32)
    return {"fit": seconds, "db": decibels(numpy_nsvd.error(core, energy)), "what": "hosvd"}


if __name__ == "__main__":
    main()
