"""Makes OpenEXR and Radiance pictures."""

import tempfile
from pathlib import Path

import numpy as np
import OpenEXR


def exr(channels: dict[str, np.ndarray], **header) -> bytes:
    """An OpenEXR file of channels (row, column), float16 or float32, top row first."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.exr"
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header
        # The library writes planes as they lie in memory, whatever their strides.
        planes = {name: np.ascontiguousarray(plane) for name, plane in channels.items()}
        OpenEXR.File(header, planes).write(str(path))
        return path.read_bytes()


def exr_of(pixels: np.ndarray, names="RGB", **header) -> bytes:
    """An OpenEXR file of pixels (row, column, channel)."""
    return exr({name: pixels[..., i] for i, name in enumerate(names)}, **header)


def rgbe(values: np.ndarray) -> np.ndarray:
    """Values (..., 3) as mantissas and exponent (..., 4) uint8, rounded down."""
    largest = values.max(axis=-1)
    exponent = np.where(largest > 0, np.frexp(largest)[1], -128)
    mantissas = np.floor(values * np.exp2(8.0 - exponent)[..., None])
    return np.concatenate([mantissas, exponent[..., None] + 128], axis=-1).astype(np.uint8)


def from_rgbe(pixels: np.ndarray) -> np.ndarray:
    """What mantissas and exponent (..., 4) mean, (..., 3) float64."""
    exponent = pixels[..., 3:].astype(float)
    return np.where(exponent > 0, pixels[..., :3] * np.exp2(exponent - 136), 0)


def hdr(pixels: np.ndarray, size: str = "", header: str = "", runs: bool = True) -> bytes:
    """A Radiance file of pixels (row, column, 4) uint8 in the order of the file.

    `runs`: rows are encoded by channel, as most programs write them; else flat.
    """
    height, width, _ = pixels.shape
    size = size or f"-Y {height} +X {width}"
    start = f"#?RADIANCE\n{header}FORMAT=32-bit_rle_rgbe\n\n{size}\n".encode()
    if not runs:
        return start + pixels.tobytes()
    body = b"".join(
        bytes([2, 2, width >> 8, width & 255]) + b"".join(_runs(row[:, i]) for i in range(4))
        for row in pixels
    )
    return start + body


def _runs(values: np.ndarray) -> bytes:
    """One channel of a row: what is equal from three on as runs, the rest as it is."""
    out, i, data = b"", 0, values.tolist()
    while i < len(data):
        count = 1
        while i + count < len(data) and count < 127 and data[i + count] == data[i]:
            count += 1
        if count < 3:
            count = min(2, len(data) - i)
            out += bytes([count, *data[i : i + count]])
        else:
            out += bytes([128 + count, data[i]])
        i += count
    return out
