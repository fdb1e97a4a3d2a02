"""What a reader hands over: a described dataset whose samples come block by block."""

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .dataset import KINDS

# What a reader decodes at a time; it holds about four times this, whatever the tensor's size.
BLOCK_BYTES = 32 * 2**20

CHANNELS = ["R", "G", "B"]

# The width of a patch in metres when the file does not tell: a piece of cloth in the hand.
DEFAULT_PATCH_WIDTH = 0.01


@dataclass(frozen=True, eq=False)
class Source:
    """A BTF, or another kind of dataset, in some file format.

    `light` (L, 3), which occlusion lacks, and `view` (V, 3) are unit vectors, `shape` has the
    kind's axes, `dtype` is what the values deserve, `conversions` what was done or assumed to get
    to Nacre's conventions, `details` what only this format knows. `blocks()` starts reading: it
    yields C-order contiguous pieces of the samples, one after the other, and raises NacreError.
    Where `by_texel`, the pieces are (light, view, texel, channel) of consecutive texels, as files
    that are stored texel by texel give them. `memory` is about how many bytes reading takes; None
    stands for a few blocks.
    """

    path: Path
    format: str
    light: np.ndarray | None
    view: np.ndarray
    shape: tuple[int, ...]
    dtype: np.dtype
    patch_size: tuple[float, float]
    conversions: list[str]
    details: dict[str, Any]
    bytes: int
    blocks: Callable[[], Generator[np.ndarray]]
    kind: str = "btf"
    by_texel: bool = False
    memory: int | None = None

    def description(self) -> dict[str, Any]:
        """The content of dataset.json.

        No measured format says whether a patch repeats; materials are shown by repeating them.
        """
        own: dict[str, Any] = {"value": "mask"}
        if self.light is not None:
            own = {"light": self.light.tolist(), "channels": CHANNELS}
        return {
            "nacre": 1,
            "kind": self.kind,
            "axes": list(KINDS[self.kind]),
            "view": self.view.tolist(),
            **own,
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
        """What `info` shows, JSON-able; sizes in bytes, `samples_bytes` once imported,
        `memory_bytes` while that goes on."""
        samples = math.prod(self.shape) * self.dtype.itemsize
        memory = 4 * min(samples, BLOCK_BYTES) if self.memory is None else self.memory
        sizes = dict(zip(KINDS[self.kind], self.shape, strict=True))
        colour = {"channels": CHANNELS, "colour_model": None, "cosine_flag": None}
        return {
            "format": self.format,
            **{axis: sizes[axis] for axis in ("light", "view") if axis in sizes},
            "width": sizes["x"],
            "height": sizes["y"],
            **(colour | {"components": None} if "channel" in sizes else {"value": "mask"}),
            **self.details,
            "bytes": self.bytes,
            "samples_bytes": samples,
            "memory_bytes": memory,
            "conversions": self.conversions,
        }


def assumed_patch_size(width: int, height: int) -> tuple[float, float]:
    """Patch size in metres for a file that does not tell its scale: square texels."""
    return DEFAULT_PATCH_WIDTH, DEFAULT_PATCH_WIDTH * height / width
