"""Light from all around: the light basis convolved with an environment (MK-CTA, Section 5.1).

Under an environment of radiance L, a shading point of the frame F has the light vector

    E(F)[c_v, channel, c_l, r] = 1 / pi * integral over the hemisphere of
                                 L(F omega) light[c_v, channel, c_l, r](omega) d omega

(values are pi f_r cos), which stands where one light's row stands: radiance is its product with the
core contracted with the view, of all C_light clusters. The vectors are kept for every orientation
of the frame (tables.orientations), so a world that turns only turns what is looked up.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from ..errors import NacreError
from .evaluate import light_rows, reduced_points
from .light_lobes import LightLobes
from .orientations import HALF_TURNS, corners_of, grid_frames
from .parabolic import texel_directions, texel_of
from .tables import Tables, quads
from .world_picture import (
    Picture,
    filter_picture,
    picture_directions,
    pixel_of,
    resize_picture,
    solid_angles,
)

GRID = 25
"""Orientations along an edge of a cube, 7.5 degrees apart."""

CLUSTERED_GRID = 17
"""The same where lights are clustered and there are many more vectors: 11 degrees apart."""

_FILTERED = (128, 256)  # pixels of the filtered environment, which is smooth
_CHUNK = 512  # orientations convolved at a time, which bounds the memory


@dataclass(frozen=True)
class EnvironmentTable:
    """The light basis convolved with an environment, for every orientation of the surface frame.

    vectors  (owners, channels, C_light, light quads, 2, 4, G, G, G, 4) float16: right- and
             left-handed frames, half turns of the world, and a cube's axes y, z, x, so that each
             quad is a picture of 8 G rows and G * G columns; owners C_view or 1
    scale    what the vectors are multiplied with
    rank     R_light; quads are filled up with zeros
    """

    vectors: NDArray[np.float16]
    scale: float
    rank: int

    @property
    def grid(self) -> int:
        """Orientations along an edge of a cube."""
        return self.vectors.shape[-2]


def build_environment(lobes: LightLobes, radiance: Picture, grid: int = 0) -> EnvironmentTable:
    """Convolve the light basis with an environment (height, width, channels) as Blender maps it
    (tables.world_picture).

    `grid` 0 is GRID or, for clustered lights, CLUSTERED_GRID. Raises NacreError for radiance that
    is not finite.
    """
    if not np.isfinite(radiance).all():
        raise NacreError("the environment holds pixels that are no finite numbers")
    small = resize_picture(radiance, *_FILTERED)
    # The four half turns side by side: they map pixels to pixels.
    filtered = filter_picture(small, lobes.sharpness).reshape(-1, small.shape[2]) / pi
    directions = picture_directions(*_FILTERED).reshape(-1, 3)
    turned = np.stack(
        [filtered[pixel_of(directions * signs, *_FILTERED)] for signs in HALF_TURNS], 1
    ).astype(np.float32)  # (pixel, turn, channel)

    rows = np.broadcast_to(
        lobes.weights,
        (*lobes.weights.shape[:2], small.shape[2], *lobes.weights.shape[3:]),
    )
    count, owners, channels, clusters, rank = rows.shape
    grid = grid or (GRID if clusters == 1 else CLUSTERED_GRID)
    handed = np.stack([rows, rows[lobes.mirror]], 1)  # (lobe, hand, owner, channel, C_light, R)
    handed = np.moveaxis(handed, 3, 0).reshape(channels, count, -1)
    frames = grid_frames(grid).reshape(-1, 3, 3)
    vectors = np.empty((channels, len(frames), 4, handed.shape[-1]), np.float32)
    for first in range(0, len(frames), _CHUNK):
        part = slice(first, first + _CHUNK)
        seen = turned[pixel_of(lobes.centres @ frames[part], *_FILTERED)]
        np.matmul(
            seen.transpose(3, 0, 2, 1).reshape(channels, -1, count),
            handed,
            out=vectors[:, part].reshape(channels, -1, handed.shape[-1]),
        )
    scale = max(float(np.abs(vectors).max()), 1e-12)
    vectors *= 1.0 / scale
    vectors = vectors.reshape(channels, grid, grid, grid, 4, 2, owners, clusters, rank)
    packed = quads(vectors).transpose(6, 0, 7, 8, 5, 4, 1, 2, 3, 9)
    return EnvironmentTable(packed.astype(np.float16), scale, rank)


def environment_vectors(
    table: EnvironmentTable, frames: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Light vectors (n, owners, channels, C_light, R_light) of frames (n, 3, 3), rows tangent,
    bitangent and normal in the world of the environment; linear between orientations."""
    vectors = np.zeros(1, np.float32)
    for weight, hand, turn, y, z, x in corners_of(frames, table.grid):
        vectors = vectors + weight[:, None, None, None, None, None] * np.moveaxis(
            table.vectors[:, :, :, :, hand, turn, y, z, x], 4, 0
        ).astype(np.float32)
    flat = vectors.reshape(*vectors.shape[:4], -1)[..., : table.rank]
    return (flat * table.scale).astype(np.float32)


def evaluate_environment(
    tables: Tables,
    table: EnvironmentTable,
    frames: NDArray[np.floating],
    view: NDArray[np.floating],
    uv: NDArray[np.floating],
) -> NDArray[np.float32]:
    """Radiance (n, channel) at n points under an environment: frames (n, 3, 3) as for
    environment_vectors, unit views (n, 3) in the tangent frame, texture coordinates (n, 2)."""
    return _radiance(environment_vectors(table, frames), tables, view, uv)


def integrate_environment(
    tables: Tables, radiance: Picture, frames: NDArray[np.floating]
) -> NDArray[np.float32]:
    """What environment_vectors approximates, by brute force: every pixel of the environment above
    the horizon of each frame, times the light row of its texel. (n, owners, channels, C_light,
    R_light)."""
    height, width, channels = radiance.shape
    directions = picture_directions(height, width).reshape(-1, 3).astype(np.float32)
    power = (radiance * solid_angles(height, width)[:, None, None] / pi).reshape(-1, channels)
    rows = light_rows(tables, texel_directions(tables.size).reshape(-1, 3))
    _, own, clusters, owners, rank = rows.shape
    rows = rows.transpose(1, 3, 2, 4, 0).reshape(own, -1, len(rows))
    vectors = np.empty((len(frames), channels, owners, clusters, rank), np.float32)
    for first in range(0, len(frames), 16):
        part = np.asarray(frames, np.float32)[first : first + 16]
        received = np.zeros((channels, len(part), tables.size**2), np.float32)
        for number, frame in enumerate(part):
            local = directions @ frame.T
            above = local[:, 2] > 0.0
            column, row = texel_of(local[above], tables.size).T
            texel = row * tables.size + column
            for channel, values in enumerate(power.T):
                received[channel, number] = np.bincount(texel, values[above], tables.size**2)
        for channel, texels in enumerate(received):
            found = texels @ rows[min(channel, own - 1)].T
            vectors[first : first + 16, channel] = found.reshape(-1, owners, clusters, rank)
    return np.moveaxis(vectors, 1, 2)


def integrated_points(
    tables: Tables,
    radiance: Picture,
    frames: NDArray[np.floating],
    view: NDArray[np.floating],
    uv: NDArray[np.floating],
) -> NDArray[np.float32]:
    """What evaluate_environment approximates, by brute force."""
    return _radiance(integrate_environment(tables, radiance, frames), tables, view, uv)


def _radiance(
    vectors: NDArray[np.float32],
    tables: Tables,
    view: NDArray[np.floating],
    uv: NDArray[np.floating],
) -> NDArray[np.float32]:
    values = np.einsum("nvclr,nvlr->nc", vectors, reduced_points(tables, view, uv), optimize=True)
    return np.maximum(values, 0.0).astype(np.float32)
