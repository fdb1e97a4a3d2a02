"""Write a dataset as a file of other programs: Bonn's .btf or a UBO2003 .zip."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import NacreError
from .arguments import Progress, from_1

if TYPE_CHECKING:
    from ..datasets.dataset import Dataset

ENDINGS = {".btf": "btf", ".zip": "ubo2003"}
COLOUR_MODELS = {"rgb": 0, "log": 11}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", type=Path)
    parser.add_argument("file", type=Path)
    parser.add_argument(
        "--format",
        choices=sorted(ENDINGS.values()),
        help="as the file's ending says, when not given",
    )
    parser.add_argument(
        "--components", type=from_1, metavar="N", help="of each colour of a .btf (64)"
    )
    parser.add_argument(
        "--colour",
        choices=sorted(COLOUR_MODELS),
        help="what a .btf factorises: rgb, which is nearest in squared error, or the log of "
        "luminance, as Bonn's database (rgb)",
    )


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..datasets.dataset import open_dataset

    format = options.format or ENDINGS.get(options.file.suffix.lower())
    if format is None:
        raise NacreError(
            f"{options.file}: expected a name that ends with .btf or .zip, or --format"
        )
    dataset = open_dataset(options.dataset)
    write = {"btf": _write_btf, "ubo2003": _write_ubo2003}[format]
    said = write(dataset, options, progress)
    return {"what": "measured file", "format": format, **said}


def _write_btf(dataset: Dataset, options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..datasets.btf_writer import COMPONENTS, write_btf

    return write_btf(
        dataset,
        options.file,
        components=options.components or COMPONENTS,
        colour_model=COLOUR_MODELS[options.colour or "rgb"],
        progress=progress,
    )


def _write_ubo2003(
    dataset: Dataset, options: argparse.Namespace, progress: Progress
) -> dict[str, Any]:
    from ..datasets.ubo2003_writer import write_ubo2003

    for option in ("components", "colour"):
        if getattr(options, option) is not None:
            raise NacreError(f"UBO2003 files are images, which take no --{option}")
    return write_ubo2003(dataset, options.file, progress=progress)
