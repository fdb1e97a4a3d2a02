"""Run a job in a process of its own, and watch its memory.

Peak memory beyond the input is the largest anonymous resident memory (RssAnon in
/proc/PID/status, read every few milliseconds by this process) while the job runs, less what was
there when it started: the interpreter, its modules and the opened dataset, whose samples are
mapped file pages and so do not count. VmHWM, the kernel's own peak, would count those pages too.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

POLL = 0.002


@dataclass(frozen=True)
class Measured:
    seconds: float
    peak: int  # bytes beyond the start
    value: Any  # what the job returned


def measured(prepare: Callable[..., Any], job: Callable[..., Any], *arguments: Any) -> Measured:
    """`job(prepare(*arguments))` in a new process; only the job is measured.

    Both are functions of modules. Raises RuntimeError if the process dies.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_run, args=(theirs, prepare, job, arguments))
    process.start()
    theirs.close()
    try:
        ours.recv()
        start = peak = anonymous(process.pid)
        ours.send(None)
        while not ours.poll(POLL):
            peak = max(peak, anonymous(process.pid))
        seconds, value = ours.recv()
    except EOFError as error:
        raise RuntimeError(f"{job.__module__}.{job.__name__}: the process ended early") from error
    finally:
        process.join()
    return Measured(seconds, peak - start, value)


def _run(
    pipe: Connection, prepare: Callable[..., Any], job: Callable[..., Any], arguments: Any
) -> None:
    prepared = prepare(*arguments)
    pipe.send(None)
    pipe.recv()
    started = time.perf_counter()
    value = job(prepared)
    pipe.send((time.perf_counter() - started, value))
    pipe.close()


def anonymous(pid: int | None) -> int:
    """Anonymous resident memory of a process in bytes; 0 once it has ended."""
    try:
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("RssAnon:"):
                return 1024 * int(line.split()[1])
    except OSError:
        pass
    return 0
