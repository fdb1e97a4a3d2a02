"""What this machine can do at most: single-precision matrix products, and memory bandwidth.

Both with the OpenBLAS that lies beside the compiled helper and, like the helper, with threads that
each call it alone.
"""

from __future__ import annotations

import ctypes
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import nacre_native
import numpy as np

SIDE = 1536
STREAM = 1 << 25  # floats in each thread's array: 128 MiB, far beyond the caches
_ROW_MAJOR, _PLAIN = 101, 111


def threads() -> int:
    """Threads that a fit uses unless told otherwise."""
    return os.cpu_count() or 1


@cache
def _library() -> ctypes.CDLL:
    path = Path(nacre_native.__file__).with_name("libnacre_openblas.so")
    library = ctypes.CDLL(str(path))
    library.scipy_openblas_set_num_threads(1)
    library.scipy_cblas_sdot.restype = ctypes.c_float
    return library


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _best(work: Callable[[int], None], count: int, repeats: int = 5) -> float:
    """Shortest time in which `count` threads each do `work` once."""
    best = float("inf")
    with ThreadPoolExecutor(count) as pool:
        for _ in range(repeats):
            started = time.perf_counter()
            list(pool.map(work, range(count)))
            best = min(best, time.perf_counter() - started)
    return best


def sgemm_rate(count: int = 0) -> float:
    """Operations a second of single-precision matrix products (1536 square), `count` threads."""
    count = count or threads()
    library = _library()
    random = np.random.default_rng(0)
    operands = [
        tuple(random.random((SIDE, SIDE), np.float32) for _ in range(3)) for _ in range(count)
    ]

    def work(thread: int) -> None:
        a, b, c = operands[thread]
        sizes = [ctypes.c_int(SIDE)] * 3
        library.scipy_cblas_sgemm(
            _ROW_MAJOR, _PLAIN, _PLAIN, *sizes, ctypes.c_float(1), _pointer(a), SIDE, _pointer(b),
            SIDE, ctypes.c_float(0), _pointer(c), SIDE,
        )  # fmt: skip

    return 2 * SIDE**3 * count / _best(work, count)


def bandwidth(count: int = 0) -> float:
    """Bytes a second that `count` threads read from memory in inner products, or move in copies:
    the larger of both."""
    count = count or threads()
    library = _library()
    arrays = [(np.ones(STREAM, np.float32), np.ones(STREAM, np.float32)) for _ in range(count)]

    def read(thread: int) -> None:
        a, b = arrays[thread]
        library.scipy_cblas_sdot(STREAM, _pointer(a), 1, _pointer(b), 1)

    def copy(thread: int) -> None:
        np.copyto(*arrays[thread])

    moved = 2 * 4 * STREAM * count
    return max(moved / _best(read, count), moved / _best(copy, count))


def report(count: int = 0) -> tuple[float, float]:
    """Measure and print both; returns (operations, bytes) a second."""
    count = count or threads()
    products, moved = sgemm_rate(count), bandwidth(count)
    core = os.environ.get("OPENBLAS_CORETYPE", "as detected")
    print(
        f"sgemm {products / 1e9:.0f} GFLOP/s, memory {moved / 1e9:.1f} GB/s "
        f"({count} threads, OpenBLAS core type {core})"
    )
    return products, moved
