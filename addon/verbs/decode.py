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

RANGES = ("light", "view", "y", "x")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("model", type=Path)
    parser.add_argument("dataset", type=Path)
    for axis in RANGES:
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
    from ..samples import blocks
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
    rows, columns = (
        len(range(size)[part])
        for size, part in zip(model.shape[2:4], (options.y, options.x), strict=True)
    )
    shape = (len(lights), len(views), rows, columns, model.channels)
    for axis, size in zip(RANGES, shape, strict=False):
        if size == 0:
            raise NacreError(f"the range --{axis} leaves nothing of the {axis} axis")
    description = _describe(model, lights, views, rows, columns)
    if options.directions:
        tables = build_tables(model, progress=progress)
    with DatasetWriter(options.dataset, description, shape, np.float32) as writer:
        for part in blocks(shape):
            if options.directions:
                block = evaluate_patch(tables, lights[part], views)[:, :, options.y, options.x]
            else:
                block = model.decode(numbers[part], options.view, options.y, options.x)
            writer.write(block)
            if not progress(writer.fraction, "Decoding"):
                raise Cancelled
    return describe_dataset(open_dataset(options.dataset))


def _describe(
    model: ClusteredTucker, lights: np.ndarray, views: np.ndarray, rows: int, columns: int
) -> dict[str, Any]:
    """The content of dataset.json for a part of the model's patch."""
    _, _, height, width, _ = model.shape
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
