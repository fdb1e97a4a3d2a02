"""Side channels of a patch as seen from above: what artists use beside the BTF."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR

from ..render.stage import new_scene
from .cycles import render, set_up_cycles
from .oblique_camera import add_orthographic
from .patch import Patch, place

# Every texel is rendered as a square of so many pixels, as Cycles takes the position of one sample
# a pixel, and Blender renders no picture of less than 4 pixels in width or height.
PIXELS, SAMPLES = 4, 8


def measure_top_view(patch: Patch, texels: tuple[int, int]) -> dict[str, np.ndarray]:
    """Pictures (y, x, 3 or 1) float32 of a patch, y upward, each texel the mean of what covers it.

    albedo: linear RGB, of all of the surface's layers.
    normal: 0.5 + 0.5 n, as the Normal Map node takes it, n the shading normal.
    height: metres above the reference plane, as the Displacement node takes it; (y, x, 1).
    Holes are black, level and at height 0.
    """
    with new_scene((PIXELS * texels[0], PIXELS * texels[1])) as scene:
        set_up_cycles(scene, SAMPLES, 0)
        top = place(scene, patch, 0.0)
        # Displacement may rise above the objects' bounds.
        height = top + 4.0 * max(patch.size)
        add_orthographic(scene, patch.size, 4.0 * height).location.z = height
        layer = scene.view_layers[0]
        layer.use_pass_normal = layer.use_pass_position = True
        layer.cycles.denoising_store_passes = True  # the albedo of all layers is one of them
        passes = render(scene, 0)
    covered = passes["Combined"][..., 3:]
    position = _channels(passes, "Position")
    hit = (position != 0.0).any(-1, keepdims=True).astype(np.float32)
    # Passes are sums over the samples, to which those in a hole add nothing.
    albedo = _mean(_channels(passes, "Denoising Albedo"), covered)
    normal = _mean(_channels(passes, "Normal"), covered)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = np.where(length > 1e-3, normal / np.maximum(length, 1e-3), np.float32((0, 0, 1)))
    height = _mean(position[..., 2:], hit)
    return {"albedo": albedo, "normal": 0.5 + 0.5 * normal, "height": height}


def _mean(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The means of texels (y, x, c) from weighted pixels (Y, X, c) and their weights (Y, X, 1)."""
    total, weight = (
        array.reshape(len(array) // PIXELS, PIXELS, -1, PIXELS, array.shape[-1]).sum((1, 3))
        for array in (values, weights)
    )
    return total / np.maximum(weight, 1e-6)


def write_side_channels(folder: Path, channels: dict[str, np.ndarray]) -> None:
    """NAME.exr, single precision, for each of `measure_top_view`'s pictures."""
    for name, values in channels.items():
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        key, pixels = ("RGB", values) if values.shape[-1] == 3 else ("Y", values[..., 0])
        top_first = np.ascontiguousarray(pixels[::-1], np.float32)
        OpenEXR.File(header, {key: top_first}).write(str(folder / f"{name}.exr"))


def _channels(passes: dict[str, np.ndarray], title: str) -> np.ndarray:
    """A pass's three channels, which a file names RGB or XYZ."""
    if title in passes:
        return passes[title]
    return np.stack([passes[f"{title}.{axis}"] for axis in "XYZ"], -1)
