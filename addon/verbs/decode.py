"""Turn a model back into samples: of occlusion, into masks."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import Cancelled, NacreError
from .arguments import Progress, from_1, index_range

if TYPE_CHECKING:
    import numpy as np

    from ..models.any_model import Model
    from ..models.clustered_tucker import ClusteredTucker
    from ..models.sparse.interpolation import Images

RANGES = ("light", "view", "y", "x")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("model", type=Path)
    parser.add_argument("dataset", type=Path)
    for axis in RANGES:
        parser.add_argument(f"--{axis}", type=index_range, default=slice(None), metavar="I:J")
    parser.add_argument(
        "--directions",
        type=Path,
        help="CSV of theta,phi in degrees: every light and view of the list, interpolated",
    )
    parser.add_argument(
        "--kernel",
        choices=("linear", "gaussian"),
        help="how sparse codes mix the directions around one of --directions (linear)",
    )
    parser.add_argument(
        "--interpolation",
        choices=("coefficient", "image"),
        help="of sparse codes: of coefficients (default), or of images, slower, to compare with",
    )
    parser.add_argument(
        "--quality",
        type=from_1,
        metavar="N",
        help="of sparse codes, the most important ones: N latent-equivalents, 16 to 256 as a rule",
    )
    parser.add_argument(
        "--raw", action="store_true", help="of occlusion, the fitted values instead of masks"
    )


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    import numpy as np

    from ..datasets.dataset import DatasetWriter, open_dataset
    from ..datasets.directions import read_directions_csv
    from ..models.any_model import load_any
    from ..models.interpolation import horizon_fade
    from ..models.resample import resample
    from ..models.sparse.interpolation import at_directions, images_at_directions
    from ..models.sparse.model import SparseBtf
    from ..samples import blocks
    from .info import describe_dataset

    model = load_any(options.model)
    for option in ("quality", "kernel", "interpolation"):
        if getattr(options, option) and not isinstance(model, SparseBtf):
            raise NacreError(f"{options.model}: --{option} is for sparse codes")
    for option in ("kernel", "interpolation"):
        if getattr(options, option) and not options.directions:
            raise NacreError(f"--{option} is how --directions are reached: give some")
    if isinstance(model, SparseBtf):
        model = model.truncated(options.quality or model.quality)
    elif model.kind == "occlusion":
        return _decode_occlusion(model, options, progress)
    if options.raw:
        raise NacreError(f"{options.model}: --raw is for occlusion")
    if options.directions:
        lights = views = read_directions_csv(options.directions)
    else:
        lights, views = np.asarray(model.dataset["light"]), np.asarray(model.dataset["view"])
    kept_lights = np.arange(len(lights))[options.light]
    kept_views = np.arange(len(views))[options.view]
    lights, views = lights[kept_lights], views[kept_views]
    rows, columns = (
        len(range(size)[part])
        for size, part in zip(model.shape[2:4], (options.y, options.x), strict=True)
    )
    shape = (len(lights), len(views), rows, columns, model.channels)
    _check_ranges(RANGES, shape)
    description = _describe(model, lights, views, rows, columns)
    decoded: Model | Images = model
    if options.directions:
        progress(0.0, "Resampling")
        fade = horizon_fade(np.asarray(model.dataset["light"]), lights).astype(np.float32)
        if isinstance(model, SparseBtf):
            mixing = images_at_directions if options.interpolation == "image" else at_directions
            decoded = mixing(model, lights, views, options.kernel or "linear")
        else:
            decoded = resample(model, lights, views)
        kept_lights, kept_views = np.arange(len(lights)), np.arange(len(views))
    with DatasetWriter(options.dataset, description, shape, np.float32) as writer:
        for part in blocks(shape):
            block = decoded.decode(kept_lights[part], kept_views, options.y, options.x)
            if options.directions:
                block *= fade[part, None, None, None, None]
            writer.write(block)
            if not progress(writer.fraction, "Decoding"):
                raise Cancelled
    return describe_dataset(open_dataset(options.dataset))


def _decode_occlusion(
    model: ClusteredTucker, options: argparse.Namespace, progress: Progress
) -> dict[str, Any]:
    """Write a model's masks, or the values it was fitted to, as they stand."""
    import numpy as np

    from ..datasets.dataset import KINDS, DatasetWriter, open_dataset
    from ..datasets.directions import read_directions_csv
    from ..datasets.occlusion import is_covered
    from ..models.resample import resample
    from ..samples import blocks
    from .info import describe_dataset

    if options.light != slice(None):
        raise NacreError(f"{options.model}: holds occlusion, which takes no --light")
    if options.directions:
        model = resample(model, views=read_directions_csv(options.directions))
    axes = KINDS[model.kind]
    rows = [
        np.arange(size)[getattr(options, axis)]
        for axis, size in zip(axes, model.shape, strict=True)
    ]
    shape = tuple(len(indices) for indices in rows)
    _check_ranges(axes, shape)
    value = model.dataset["value"]
    description = {
        **_describe_patch(model, *shape[1:]),
        "kind": model.kind,
        "axes": list(axes),
        "view": np.asarray(model.dataset["view"])[rows[0]].tolist(),
        "value": value if options.raw else "mask",
    }
    dtype = np.float32 if options.raw else np.float16
    with DatasetWriter(options.dataset, description, shape, dtype) as writer:
        for part in blocks(shape):
            block = model.decode(view=rows[0][part], y=rows[1], x=rows[2])
            writer.write(block if options.raw else is_covered(block, value))
            if not progress(writer.fraction, "Decoding"):
                raise Cancelled
    return describe_dataset(open_dataset(options.dataset))


def _check_ranges(axes: Sequence[str], shape: Sequence[int]) -> None:
    """Raise NacreError for a range that leaves nothing."""
    for axis, size in zip(axes, shape, strict=False):
        if size == 0:
            raise NacreError(f"the range --{axis} leaves nothing of the {axis} axis")


def _describe(
    model: Model, lights: np.ndarray, views: np.ndarray, rows: int, columns: int
) -> dict[str, Any]:
    """The content of dataset.json for a part of the model's patch."""
    return {
        **_describe_patch(model, rows, columns),
        "kind": "btf",
        "axes": ["light", "view", "y", "x", "channel"],
        "light": lights.tolist(),
        "view": views.tolist(),
        "channels": model.dataset["channels"],
    }


def _describe_patch(model: Model, rows: int, columns: int) -> dict[str, Any]:
    """What any kind's dataset.json says of a part of the model's patch."""
    height, width = model.shape[2:4] if model.kind == "btf" else model.shape[1:]
    patch_width, patch_height = model.dataset["patch_size"]
    return {
        "nacre": 1,
        "patch_size": [patch_width * columns / width, patch_height * rows / height],
        "periodic": model.dataset["periodic"] and (rows, columns) == (height, width),
        "noise_floor_db": model.dataset["noise_floor_db"],
        "source": model.dataset["source"],
    }
