"""Reads one input with one reader, and says what a reader must never do.

Whatever the bytes, a reader gives blocks or raises NacreError with one line. It never raises
anything else, warns, takes memory that the file does not need, or hangs.
"""

import atexit
import functools
import shutil
import signal
import sys
import tempfile
import threading
import tracemalloc
import warnings
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from addon.datasets.importing import READERS, describe_source
from addon.datasets.options import Options
from addon.datasets.source import BLOCK_BYTES
from addon.errors import NacreError

HERE = Path(__file__).resolve().parent
CORPUS = HERE / "corpus"
# Targets make their seeds with the writers that lie beside the readers' tests.
sys.path.insert(0, str(HERE.parent / "datasets"))
_OWN = {"harness", "mutations", "test_fuzz", "__init__", "__main__"}
TARGETS = sorted(path.stem for path in HERE.glob("*.py") if path.stem not in _OWN)

ENOUGH_BYTES = 64 * 2**20
"""After so many bytes of samples the rest is taken to be alike."""

# What a reader may hold besides what is in proportion to its file: a block at several precisions.
_MEMORY = 5 * BLOCK_BYTES
_MEMORY_PER_BYTE = 64
_SECONDS = 10


def target(name: str) -> ModuleType:
    """The module of a target: SUFFIX, seeds(), and READER where that is not the target's name."""
    return import_module(f"{__package__}.{name}")


def reader_of(module: ModuleType) -> str:
    return getattr(module, "READER", module.__name__.rpartition(".")[2])


def inputs(name: str) -> dict[str, bytes]:
    """A target's seeds and what earlier runs found, by name."""
    found = {path.name: path.read_bytes() for path in sorted((CORPUS / name).glob("*"))}
    return target(name).seeds() | found


def read(module: ModuleType, data: bytes) -> str | None:
    """Describe and read a file with these bytes; returns the error that it was refused with.

    A target may have `wrap(data)`, which makes the file's bytes of the input, `smaller()`, a
    context in which the reader of large files takes small ones, and `options(folder)`, what its
    files need beside them. Raises AssertionError for too much
    memory and for an error that is not one line, and whatever the reader raises besides NacreError.
    """
    path = _folder() / f"input{module.SUFFIX}"
    given = module.options(_folder()) if hasattr(module, "options") else {}
    path.write_bytes(getattr(module, "wrap", bytes)(data))
    smaller = getattr(module, "smaller", nullcontext)
    with warnings.catch_warnings(), smaller():
        warnings.simplefilter("error")
        tracemalloc.start()
        try:
            _read(reader_of(module), path, given)
            return None
        except NacreError as error:
            assert str(error)
            assert "\n" not in str(error)
            return str(error)
        finally:
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            assert peak < _MEMORY + _MEMORY_PER_BYTE * len(data), f"{peak} bytes of memory"


@functools.cache
def _folder() -> Path:
    """One for all inputs: making folders takes longer than reading files."""
    folder = tempfile.mkdtemp(prefix="nacre-fuzz-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def _read(reader: str, path: Path, given: dict[str, Any]) -> None:
    describe_source(path, format=reader, **given)
    source = READERS[reader].open_source(path, Options(**given))
    taken = 0
    with closing(source.blocks()) as blocks:
        for block in blocks:
            assert block.flags.c_contiguous
            taken += block.nbytes
            if taken > ENOUGH_BYTES:
                break


@contextmanager
def time_limit(seconds: int = _SECONDS) -> Iterator[None]:
    """Raises TimeoutError in the main thread where the system has alarms; else no limit."""
    if not hasattr(signal, "SIGALRM") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: object) -> None:
        raise TimeoutError(f"more than {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
