"""Fuzz one reader, guided by coverage: python -m tests.fuzz NAME [--seconds N], or --keep.

What is found is kept under build/fuzz/NAME; --keep copies from there to the corpus in the tests
what goes through the reader another way than the seeds and smaller files do. Fuzzing needs atheris
(requirements/fuzz.txt).
"""

import argparse
import hashlib
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
ADDON = str(ROOT / "addon")


def main() -> None:
    parser = argparse.ArgumentParser(prog="tests.fuzz", description=__doc__)
    parser.add_argument("name")
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--keep", action="store_true")
    options = parser.parse_args()
    if options.keep:
        keep(options.name)
    else:
        fuzz(options.name, options.seconds)


def fuzz(name: str, seconds: int) -> None:
    """Does not return: libFuzzer ends the process."""
    import atheris

    with atheris.instrument_imports(include=["addon"]):
        from tests.fuzz import harness
    module = harness.target(name)
    corpus, work = harness.CORPUS / name, work_folder(name)
    for folder in (corpus, work):
        folder.mkdir(parents=True, exist_ok=True)
    tempfile.tempdir = str(work.parent)  # nothing is tidied up
    seeds = module.seeds()
    for label, data in seeds.items():
        (work / f"seed-{label}").write_bytes(data)
    arguments = [
        "-timeout=10",
        "-rss_limit_mb=1024",
        f"-max_len={2 * max(map(len, seeds.values()))}",
        f"-max_total_time={seconds}",
        f"-artifact_prefix={work.parent}/{name}-",
        "-print_final_stats=1",
        str(work),
        str(corpus),
    ]

    def test_one(data: bytes) -> None:
        harness.read(module, data)

    atheris.Setup([sys.argv[0], *arguments], test_one)
    atheris.Fuzz()


def keep(name: str) -> None:
    from tests.fuzz import harness

    module = harness.target(name)
    known: set[tuple] = set()
    for data in harness.inputs(name).values():
        known |= steps(harness.read, module, data)
    found = [path.read_bytes() for path in work_folder(name).iterdir()]
    for data in sorted(found, key=len):
        new = steps(harness.read, module, data) - known
        if new:
            known |= new
            digest = hashlib.sha256(data).hexdigest()[:16]
            (harness.CORPUS / name).mkdir(parents=True, exist_ok=True)
            (harness.CORPUS / name / digest).write_bytes(data)


def work_folder(name: str) -> Path:
    return ROOT / "build" / "fuzz" / name


def steps(read: Callable, module: ModuleType, data: bytes) -> set[tuple]:
    """From which line to which the add-on's functions went: (file, line, line)."""
    found: set[tuple] = set()

    def trace(frame: FrameType, event: str, _: Any) -> Callable | None:
        if not frame.f_code.co_filename.startswith(ADDON):
            return None
        before = 0

        def line(frame: FrameType, event: str, _: Any) -> Callable:
            nonlocal before
            found.add((frame.f_code.co_filename, before, frame.f_lineno))
            before = frame.f_lineno
            return line

        return line

    sys.settrace(trace)
    try:
        read(module, data)
    finally:
        sys.settrace(None)
    return found


main()
