"""Contact sheets: a glance at a rendered dataset or mask as one PNG."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np


def btf_sheet(samples: np.ndarray, path: Path) -> None:
    """Nine lights down, nine views across, as sRGB; samples (L, V, Y, X, 3)."""
    lights = np.linspace(0, samples.shape[0] - 1, 9).round().astype(int)
    views = np.linspace(0, samples.shape[1] - 1, 9).round().astype(int)
    rows = [np.concatenate([samples[i, j] for j in views], 1) for i in lights[::-1]]
    write_png(np.concatenate(rows, 0).astype(np.float32), path)


def mask_sheet(mask: np.ndarray, path: Path) -> None:
    """All views (V, Y, X), nine across; covered is white."""
    grey = np.repeat(mask.astype(np.float32)[..., None], 3, -1)
    rows = [np.concatenate(list(grey[i : i + 9]), 1) for i in range(0, len(grey) // 9 * 9, 9)]
    write_png(np.concatenate(rows[::-1], 0), path)


def write_png(linear: np.ndarray, path: Path) -> None:
    """Linear values (height, width, 3), bottom row first, as an 8-bit sRGB picture."""
    height, width, _ = linear.shape
    value = np.clip(linear, 0.0, 1.0)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    image = bpy.data.images.new("sheet", width, height)
    image.pixels.foreach_set(rgba.ravel())
    image.file_format, image.filepath_raw = "PNG", str(path)
    image.save()
    bpy.data.images.remove(image)
