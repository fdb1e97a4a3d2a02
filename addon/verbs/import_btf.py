"""Read any measured format, or occlusion masks, into a dataset."""

import argparse
from pathlib import Path
from typing import Any

from .arguments import Progress, above_0, gamma


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("source", type=Path)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--format", help="the reader to use, where the file does not tell")
    parser.add_argument(
        "--directions",
        type=Path,
        metavar="CSV",
        help="theta,phi in degrees: the view of each mask, of a folder of PNG images in the order "
        "of their names or of a .npy array (view, y, x); or the lights and views that a BRDF is "
        "sampled at; or, of images, file,light_theta,light_phi,view_theta,view_phi",
    )
    for name in ("lights", "views"):
        parser.add_argument(
            f"--{name}",
            metavar="SET",
            help=f"{name} that a BRDF is sampled at: ubo81 (default), ubo151, utia, uniform:N, or "
            "a CSV of theta,phi in degrees",
        )
    parser.add_argument(
        "--cosine", type=int, choices=(0, 1), help="whether values include cos(theta) of the light"
    )
    parser.add_argument(
        "--gamma", type=gamma, help="the exponent that makes values linear (1 if they are), or srgb"
    )
    parser.add_argument(
        "--colour-space", choices=("rec709", "xyz"), help="what the file's three channels are"
    )
    parser.add_argument(
        "--white",
        type=above_0,
        metavar="VALUE",
        help="the linear value, in the file's units, of a white diffuser lit head-on",
    )
    parser.add_argument(
        "--patch-width", type=above_0, metavar="METRES", help="width of the measured patch"
    )


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from dataclasses import fields

    from ..datasets.importing import import_dataset
    from ..datasets.options import Options
    from .info import describe_dataset

    dataset = import_dataset(
        options.source,
        options.dataset,
        format=options.format,
        progress=progress,
        **{field.name: getattr(options, field.name) for field in fields(Options)},
    )
    return describe_dataset(dataset)
