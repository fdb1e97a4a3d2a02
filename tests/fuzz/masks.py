"""Arrays of occlusion masks, .npy."""

import io
from pathlib import Path
from typing import Any

import numpy as np

SUFFIX = ".npy"

_VIEWS = 3


def options(folder: Path) -> dict[str, Any]:
    """The view of each mask."""
    path = folder / "views.csv"
    if not path.exists():
        path.write_text("theta,phi\n" + "30,40\n" * _VIEWS, encoding="utf-8")
    return {"directions": path}


def seeds() -> dict[str, bytes]:
    masks = np.random.default_rng(2).uniform(size=(_VIEWS, 4, 5)) < 0.5
    return {
        "bool": _npy(masks),
        "bytes": _npy(255 * masks.astype(np.uint8)),
        "half": _npy(masks.astype(">f2")),
        "fortran": _npy(np.asfortranarray(masks.astype(np.float64))),
    }


def _npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()
