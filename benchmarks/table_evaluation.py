"""Tables evaluated on the CPU: how many times faster than numpy, and how near to what is possible.

Values a second of the compiled evaluation on one thread and on all, over those of the numpy one.
The least time is the operations that the sum over nonzeros takes over the machine's rate of
single-precision products, or the bytes it needs over the memory bandwidth, whichever is longer;
the share is that over the time it took. Bytes of a patch and of a picture, whose neighbouring
pixels share texels: the core once, and the values; of points strewn about: whole cache lines of
what each fetches. Tables have the shapes of the papers' materials and random numbers.
`python -m benchmarks.table_evaluation`
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import nacre_native
import numpy as np
from numpy.typing import NDArray

from addon.tables.tables import Tables

from . import _machine, _numpy_tables
from ._report import table
from ._tables import random_tables

MATERIALS = {
    "N-SVD, Corduroy: R 20x32": ((1, 1), (1, 1), (20, 32)),
    "K-CTA, Corduroy: R 20x4, C 8, K 3": ((1, 8), (1, 3), (20, 4)),
    "MK-CTA, Hole: R 4x4, C 8x10, K 3x3": ((8, 10), (3, 3), (4, 4)),
}
PIXELS = 256
POINTS = 1 << 16
ROUNDS = 5
LINE = 64  # bytes of a cache line
_LINES = 1.25  # that two neighbouring quads lie on, on average


@dataclass(frozen=True)
class Work:
    """What is evaluated: by both, how many values, and what that takes at least."""

    numpy: Callable[[], NDArray[np.float32]]
    native: Callable[[int], NDArray[np.float32]]
    values: int
    operations: float
    bytes: float


def main() -> None:
    count = _machine.threads()
    threads = sorted({1, count})
    peak = {number: (_machine.sgemm_rate(number), _machine.bandwidth(number)) for number in threads}
    _machine.report()
    for name, shape in MATERIALS.items():
        tables = random_tables(*shape)
        header = [name, "numpy, M/s"]
        for number in threads:
            header += [f"{number} thread{'s' * (number > 1)}, M/s", "times numpy", "share"]
        rows = [header]
        for work_name, work in works(tables).items():
            _check(work)
            slow = work.values / _seconds(work.numpy, 1)
            row = [work_name, f"{slow / 1e6:.3g}"]
            for number in threads:
                seconds = _seconds(lambda work=work, number=number: work.native(number), ROUNDS)
                by = {
                    "arithmetic": work.operations / peak[number][0],
                    "memory": work.bytes / peak[number][1],
                }
                bound = max(by, key=by.__getitem__)
                rate = work.values / seconds
                row += [
                    f"{rate / 1e6:.3g}",
                    f"{rate / slow:.0f}",
                    f"{by[bound] / seconds:.0%} of {bound}",
                ]
            rows.append(row)
        print(table(rows))


def works(tables: Tables) -> dict[str, Work]:
    native = nacre_native.TableEvaluator(
        tables.core, tables.light, tables.view, tables.light_index, tables.view_index
    )
    rng = np.random.default_rng(3)

    def patch(lights: int, views: int) -> Work:
        light, view = (_hemisphere(rng, count) for count in (lights, views))
        texels = tables.core.shape[4] * tables.core.shape[5]
        used = len(_clusters(tables.light_index, light, tables.size))
        reduced, lit = _operations(tables)
        values = lights * views * texels * tables.channels
        return Work(
            lambda: _numpy_tables.evaluate_patch(tables, light, view),
            lambda threads: native.patch(light, view, threads=threads),
            values,
            texels * views * (used * reduced / len(tables.light_index) + lights * lit),
            _core_of(tables, light, view) + 4 * values,
        )

    def points(
        light: NDArray[np.floating],
        view: NDArray[np.floating],
        uv: NDArray[np.floating],
        least: float,
    ) -> Work:
        reduced, lit = _operations(tables)
        return Work(
            lambda: _numpy_tables.evaluate_points(tables, light, view, uv),
            lambda threads: native.points(light, view, uv, threads=threads),
            len(uv) * tables.channels,
            len(uv) * (4 * reduced + lit),
            least + 4 * len(uv) * tables.channels,
        )

    fetches = tables.fetches
    lines = 2 * _LINES * fetches["core"] + fetches["view"] + fetches["light"] + fetches["index"]
    strewn = (_hemisphere(rng, POINTS), _hemisphere(rng, POINTS), rng.random((POINTS, 2)))
    light, view, uv = picture()
    return {
        "patch, 1 light, 1 view": patch(1, 1),
        "patch, 16 lights, 4 views": patch(16, 4),
        "a picture's points": points(light, view, uv, _core_of(tables, light, view)),
        "points strewn about": points(*strewn, POINTS * LINE * lines),
    }


def picture() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Light, view and texture coordinates of a sphere's pixels, row by row: a sun, a camera above,
    and the patch repeated three times."""
    x, y = (np.indices((PIXELS, PIXELS)).reshape(2, -1) + 0.5) / PIXELS * 1.2 - 0.6
    up = np.column_stack([x, y, np.sqrt(1 - x**2 - y**2)])
    sun = np.array([0.3, 0.2, 0.93]) / np.linalg.norm([0.3, 0.2, 0.93])
    tangent = np.cross([0.0, 1.0, 0.0], up)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    frames = np.stack([tangent, np.cross(up, tangent), up], axis=1)
    return frames @ sun, frames[..., 2], 3 * np.column_stack([x, y])


def _operations(tables: Tables) -> tuple[float, float]:
    """Multiplications and additions of one texel: the view contracted, and one light applied."""
    lights, views = len(tables.light_index), len(tables.view_index)
    rank, quads = tables.core.shape[2:4]
    sets = views if len(tables.light) > 1 else 1
    return 2.0 * lights * views * rank * quads * 4, 2.0 * lights * sets * rank * tables.channels


def _clusters(
    index: NDArray[np.uint32], directions: NDArray[np.floating], size: int
) -> NDArray[np.uint32]:
    column, row = _numpy_tables.texel_of(directions, size).T
    return np.unique(index[:, row, column])


def _core_of(tables: Tables, light: NDArray[np.floating], view: NDArray[np.floating]) -> float:
    """Bytes of the core that these lights and views have a part in."""
    lights = len(_clusters(tables.light_index, light, tables.size))
    views = len(_clusters(tables.view_index, view, tables.size))
    return tables.core.nbytes * lights * views / (tables.core.shape[0] * tables.core.shape[1])


def _hemisphere(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    vectors = rng.normal(size=(count, 3))
    vectors[:, 2] = np.abs(vectors[:, 2]) + 0.05
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _seconds(work: Callable[[], object], rounds: int) -> float:
    """The shortest of so many."""
    best = np.inf
    for _ in range(rounds):
        started = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - started)
    return best


def _check(work: Work) -> None:
    """Stop unless both give the same numbers."""
    expected = work.numpy()
    error = float(np.abs(work.native(0) - expected).max() / np.abs(expected).max())
    if not error < 1e-5:
        raise SystemExit(f"values differ from numpy's by {error:.2g} of the largest value")


if __name__ == "__main__":
    main()
