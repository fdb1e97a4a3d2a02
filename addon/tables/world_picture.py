"""Pictures of all directions, as Blender's Environment Texture maps them.

Longitude runs along a row: +x in the middle, +y a quarter to the left, -x at both ends. The bottom
row, which is the first, is -z. Shape (height, width, channels).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.floating]


def picture_directions(height: int, width: int) -> NDArray[np.float64]:
    """Unit directions (height, width, 3) of the middles of a picture's pixels."""
    elevation = _elevations(height)[:, None]
    azimuth = (0.5 - (np.arange(width) + 0.5) / width) * (2.0 * np.pi)
    up = np.broadcast_to(np.sin(elevation), (height, width))
    return np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), up], -1
    )


def solid_angles(height: int, width: int) -> NDArray[np.float64]:
    """Solid angles (height,) of the pixels of each row, in steradians."""
    return np.diff(_sines(height)) * (2.0 * np.pi / width)


def pixel_of(directions: NDArray[np.floating], height: int, width: int) -> NDArray[np.intp]:
    """The pixel that each unit direction (..., 3) falls into, counted row by row."""
    x, y, z = np.moveaxis(directions, -1, 0)
    row = (np.arcsin(np.clip(z, -1.0, 1.0)) / np.pi + 0.5) * height
    column = (0.5 - np.arctan2(y, x) / (2.0 * np.pi)) * width
    rows = np.minimum(row.astype(np.intp), height - 1)
    return rows * width + column.astype(np.intp) % width


def resize_picture(radiance: Picture, height: int, width: int) -> NDArray[np.float64]:
    """A picture of other sizes whose pixels hold the mean radiance of their solid angle, so that no
    sun is lost between them."""
    rows = _overlap(_sines(height), _sines(radiance.shape[0]))
    columns = _overlap(np.linspace(0, 1, width + 1), np.linspace(0, 1, radiance.shape[1] + 1))
    return np.einsum("hi,ijc,wj->hwc", rows, radiance, columns, optimize=True)


def filter_picture(radiance: Picture, sharpness: float) -> NDArray[np.float64]:
    """For each pixel's direction d the integral of L(omega) exp(sharpness (d . omega - 1)), the
    picture's own pixels summed, as products in frequencies of the longitude."""
    height, width, _ = radiance.shape
    sine, cosine = np.sin(_elevations(height)), np.cos(_elevations(height))
    turn = np.cos(np.arange(width) * (2.0 * np.pi / width))
    kernel = np.multiply.outer(np.multiply.outer(cosine, cosine), turn)
    kernel += np.multiply.outer(sine, sine)[:, :, None] - 1.0
    kernel = np.fft.rfft(np.exp(sharpness * kernel), axis=-1).real  # even, so no sines
    power = np.fft.rfft(radiance * solid_angles(height, width)[:, None, None], axis=1)
    spectrum = np.matmul(kernel.transpose(2, 0, 1), power.transpose(1, 0, 2))
    return np.fft.irfft(spectrum.transpose(1, 0, 2), n=width, axis=1)


def _elevations(height: int) -> NDArray[np.float64]:
    return ((np.arange(height) + 0.5) / height - 0.5) * np.pi


def _sines(height: int) -> NDArray[np.float64]:
    """Sines of the elevations between rows (height + 1,), in which solid angle is uniform."""
    return np.sin((np.arange(height + 1) / height - 0.5) * np.pi)


def _overlap(wanted: NDArray[np.floating], given: NDArray[np.floating]) -> NDArray[np.float64]:
    """The share (wanted - 1, given - 1) of each wanted interval that lies in each given one."""
    low = np.maximum(wanted[:-1, None], given[None, :-1])
    high = np.minimum(wanted[1:, None], given[None, 1:])
    return np.maximum(high - low, 0.0) / np.diff(wanted)[:, None]
