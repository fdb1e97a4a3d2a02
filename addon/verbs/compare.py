"""Measure how far B is from A: datasets, models or pictures."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..errors import Cancelled, NacreError
from .arguments import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("a", type=Path)
    parser.add_argument("b", type=Path)


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..datasets.quality import compare_blocks
    from ..samples import blocks, open_samples

    a, b = open_samples(options.a), open_samples(options.b)
    if a.shape != b.shape:
        raise NacreError(
            f"{options.a} has shape {a.shape}, but {options.b} {b.shape}: they must be equal"
        )

    def pairs() -> Iterator[tuple[Any, Any]]:
        for part in blocks(a.shape):
            if not progress(part.start / a.shape[0], "Comparing"):
                raise Cancelled
            yield a.read(part), b.read(part)

    peak = 1.0 if options.a.suffix.lower() == ".png" else None
    return {**compare_blocks(pairs(), peak), "bytes_a": a.bytes, "bytes_b": b.bytes}
