"""Turn a model back into samples."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import Cancelled, NacreError
from .arguments import Progress, index_range

if TYPE_CHECKING:
    import numpy as np

    from ..models.clustered_tucker import ClusteredTucker


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("model", type=Path)
    parser.add_argument("dataset", type=Path)
    for axis in ("light", "view", "y", "x"):
        parser.add_argument(f"--{axis}", type=index_range, default=slice(None), metavar="I:J")
    parser.add_argument(
        "--directions",
        type=Path,
        help="CSV of theta,phi in degrees: every light and view of the list, from the same tables "
        "that materials show, clamped at 0",
    )


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    import numpy as np

    from ..datasets.dataset import DatasetWriter, open_dataset
    from ..datasets.directions import read_directions_csv
    from ..models.exr import load_model
    from ..tables.evaluate import evaluate_patch
    from ..tables.tables import build_tables
    from .info import describe_dataset

    model = load_model(options.model)
    if options.directions:
        lights = views = read_directions_csv(options.directions)
    else:
        lights, views = np.asarray(model.dataset["light"]), np.asarray(model.dataset["view"])
    numbers = np.arange(len(lights))[options.light]
    lights, views = lights[options.light], views[options.view]
    description = _describe(model, options, lights, views)
    shape = (len(lights), len(views), *_texels(model, options), model.channels)
    if options.directions:
        tables = build_tables(model, progress=progress)
    with DatasetWriter(options.dataset, description, shape, np.float32) as writer:
        for light, number in zip(lights, numbers, strict=True):
            if options.directions:
                block = evaluate_patch(tables, light[None], views)[:, :, options.y, options.x]
            else:
                block = model.decode([number], options.view, options.y, options.x)
            writer.write(block)
            if not progress(writer.fraction, "Decoding"):
                raise Cancelled
    return describe_dataset(open_dataset(options.dataset))


def _texels(model: ClusteredTucker, options: argparse.Namespace) -> tuple[int, int]:
    """How many rows and columns the ranges leave."""
    _, _, height, width, _ = model.shape
    return len(range(height)[options.y]), len(range(width)[options.x])


def _describe(
    model: ClusteredTucker, options: argparse.Namespace, lights: np.ndarray, views: np.ndarray
) -> dict[str, Any]:
    """The content of dataset.json; NacreError when the ranges leave nothing."""
    rows, columns = _texels(model, options)
    _, _, height, width, _ = model.shape
    for axis, count in zip(
        ("light", "view", "y", "x"), (len(lights), len(views), rows, columns), strict=True
    ):
        if count == 0:
            raise NacreError(f"the range --{axis} leaves nothing of the {axis} axis")
    patch_width, patch_height = model.dataset["patch_size"]
    return {
        "nacre": 1,
        "kind": "btf",
        "axes": ["light", "view", "y", "x", "channel"],
        "light": lights.tolist(),
        "view": views.tolist(),
        "channels": model.dataset["channels"],
        "patch_size": [patch_width * columns / width, patch_height * rows / height],
        "periodic": model.dataset["periodic"] and (rows, columns) == (height, width),
        "noise_floor_db": model.dataset["noise_floor_db"],
        "source": model.dataset["source"],
    }
