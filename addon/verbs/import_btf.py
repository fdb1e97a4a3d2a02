"""Read any measured format, or occlusion masks, into a dataset."""

import argparse
from pathlib import Path
from typing import Any

from .arguments import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("source", type=Path)
    parser.add_argument("dataset", type=Path)
    parser.add_argument(
        "--directions",
        type=Path,
        help="CSV of theta,phi in degrees: the view of each mask, of a folder of PNG images in the "
        "order of their names or of a .npy array (view, y, x)",
    )
    parser.add_argument("--format", help="the reader to use, where the file does not tell")
    parser.add_argument(
        "--cosine", type=int, choices=(0, 1), help="whether values include cos(theta) of the light"
    )


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..datasets.importing import import_dataset
    from .info import describe_dataset

    dataset = import_dataset(
        options.source,
        options.dataset,
        format=options.format,
        cosine=options.cosine,
        directions=options.directions,
        progress=progress,
    )
    return describe_dataset(dataset)
