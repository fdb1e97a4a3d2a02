"""Measure how far B is from A: datasets, models or pictures.

Of occlusion, error_texels counts those that only one of them covers; masks and signed distances are
compared as masks.
"""

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
    import numpy as np

    from ..datasets.occlusion import is_covered
    from ..datasets.quality import compare_blocks
    from ..samples import blocks, open_samples

    a, b = open_samples(options.a), open_samples(options.b)
    if a.shape != b.shape:
        raise NacreError(
            f"{options.a} has shape {a.shape}, but {options.b} {b.shape}: they must be equal"
        )
    if bool(a.value) != bool(b.value):
        raise NacreError(f"{options.a} and {options.b} are not both occlusion")
    error_texels = 0

    def pairs() -> Iterator[tuple[Any, Any]]:
        nonlocal error_texels
        for part in blocks(a.shape):
            if not progress(part.start / a.shape[0], "Comparing"):
                raise Cancelled
            pair = a.read(part), b.read(part)
            if a.value:
                masks = is_covered(pair[0], a.value), is_covered(pair[1], b.value)
                error_texels += int(np.count_nonzero(masks[0] != masks[1]))
                if a.value != b.value:
                    pair = masks[0].astype(np.float32), masks[1].astype(np.float32)
            yield pair

    peak = 1.0 if options.a.suffix.lower() == ".png" else None
    measures: dict[str, Any] = compare_blocks(pairs(), peak)
    if a.value:
        measures["error_texels"] = error_texels
    return {**measures, "bytes_a": a.bytes, "bytes_b": b.bytes}
