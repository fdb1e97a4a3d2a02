"""Join the parts of a virtual measurement into one dataset."""

import argparse
from pathlib import Path
from typing import Any

from .arguments import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("parts", type=Path, nargs="+", help="the parts, in any order")
    parser.add_argument("dataset", type=Path)


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..measure.merging import merge_parts
    from .info import describe_dataset

    return describe_dataset(merge_parts(options.parts, options.dataset, progress))
