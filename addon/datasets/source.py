"""What a reader hands over: a described BTF whose samples come block by block."""

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .dataset import AXES

# What a reader decodes at a time; it holds about four times this, whatever the tensor's size.
BLOCK_BYTES = 32 * 2**20

# The width of a patch in metres when the file does not tell: a piece of cloth in the hand.
DEFAULT_PATCH_WIDTH = 0.01


@dataclass(frozen=True, eq=False)
class Source:
    """A measured BTF in some file format.

    `light` (L, 3) and `view` (V, 3) are unit vectors, `shape` is (L, V, Y, X, C), `dtype` what the
    values deserve, `conversions` what was done or assumed to get to Nacre's conventions, `details`
    what only this format knows. `blocks()` starts reading: it yields C-order contiguous pieces of
    the samples, one after the other, and raises NacreError.
    """

    path: Path
    format: str
    light: np.ndarray
    view: np.ndarray
    shape: tuple[int, ...]
    dtype: np.dtype
    patch_size: tuple[float, float]
    conversions: list[str]
    details: dict[str, Any]
    bytes: int
    blocks: Callable[[], Generator[np.ndarray]]

    def description(self) -> dict[str, Any]:
        """The content of dataset.json.

        No measured format says whether a patch repeats; materials are shown by repeating them.
        """
        return {
            "nacre": 1,
            "kind": "btf",
            "axes": list(AXES),
            "light": self.light.tolist(),
            "view": self.view.tolist(),
            "channels": ["R", "G", "B"],
            "patch_size": list(self.patch_size),
            "periodic": True,
            "noise_floor_db": None,
            "source": {
                "format": self.format,
                "file": self.path.name,
                "conversions": self.conversions,
            },
        }

    def summary(self) -> dict[str, Any]:
        """What `info` shows, JSON-able; sizes in bytes, `samples_bytes` once imported."""
        lights, views, height, width, _ = self.shape
        return {
            "format": self.format,
            "light": lights,
            "view": views,
            "width": width,
            "height": height,
            "channels": ["R", "G", "B"],
            "colour_model": None,
            "cosine_flag": None,
            "components": None,
            **self.details,
            "bytes": self.bytes,
            "samples_bytes": math.prod(self.shape) * self.dtype.itemsize,
            "conversions": self.conversions,
        }


def assumed_patch_size(width: int, height: int) -> tuple[float, float]:
    """Patch size in metres for a file that does not tell its scale: square texels."""
    return DEFAULT_PATCH_WIDTH, DEFAULT_PATCH_WIDTH * height / width
