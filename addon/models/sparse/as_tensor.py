"""A sparse model fitted anew by a tensor method, for shaders that cannot loop."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ...datasets.dataset import DatasetWriter, open_dataset
from ...errors import Cancelled
from ...samples import blocks
from ..clustered_tucker import ClusteredTucker
from ..fit import compress, quality_settings
from .model import SparseBtf

QUALITY = "HIGH"
_DECODING = 0.7  # of the time


def fit_tensor(
    model: SparseBtf, progress: Callable[[float, str], bool] | None = None
) -> ClusteredTucker:
    """K-CTA of QUALITY of what a sparse model decodes to.

    Samples go to a temporary file. Raises NacreError when there is no room, Cancelled on request.
    """

    def step(fraction: float, message: str) -> bool:
        return progress is None or progress(fraction, message)

    description = {
        "nacre": 1,
        "kind": "btf",
        "axes": ["light", "view", "y", "x", "channel"],
        **{key: model.dataset[key] for key in ("light", "view", "channels", "patch_size")},
        **{key: model.dataset[key] for key in ("periodic", "noise_floor_db", "source")},
    }
    views = np.arange(model.shape[1])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "decoded.nacre"
        with DatasetWriter(path, description, model.shape, np.float16) as writer:
            for part in blocks(model.shape):
                writer.write(np.maximum(model.decode(part, views), 0.0))
                if not step(_DECODING * writer.fraction, "Decoding"):
                    raise Cancelled
        dataset = open_dataset(path)
        settings: dict[str, Any] = {**quality_settings(dataset, "kcta", QUALITY)}
        return compress(
            dataset,
            "kcta",
            **settings,
            progress=lambda f, text: step(_DECODING + (1.0 - _DECODING) * f, text),
        )
