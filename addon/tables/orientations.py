"""All orientations of a surface frame on a regular grid: rotations as four cubes of quaternions.

Unit quaternions of either sign are the same rotation, so each has one in which its largest part (of
w, x, y, z) is positive. Where that is w, the other three over w lie in [-1, 1]^3. The other cubes
are this one followed by half a turn about the world's x, y or z axis: one set of coordinates serves
all. Coordinates are a = 4 / pi atan(x / w), which makes the steps nearly as long everywhere. Where
cubes meet, their coordinates differ in order and signs alone, so grid points are the same from both
sides. A grid has an odd number of points along an edge, both ends and the middle among them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

HALF_TURNS = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], np.float32)
"""Signs of the world's axes after no turn and after half a turn about x, y and z."""


def grid_frames(grid: int) -> NDArray[np.float64]:
    """The frames (grid, grid, grid, 3, 3) of the cube without a half turn, axes y, z, x.

    A frame's rows are tangent, bitangent and normal.
    """
    steps = np.tan(np.linspace(-1.0, 1.0, grid) * np.pi / 4.0)
    y, z, x = np.meshgrid(steps, steps, steps, indexing="ij")
    square = 1.0 + x**2 + y**2 + z**2
    rows = [
        [1 + x**2 - y**2 - z**2, 2 * (x * y + z), 2 * (x * z - y)],
        [2 * (x * y - z), 1 - x**2 + y**2 - z**2, 2 * (y * z + x)],
        [2 * (x * z + y), 2 * (y * z - x), 1 - x**2 - y**2 + z**2],
    ]
    return np.moveaxis(np.array(rows) / square, (0, 1), (-2, -1))


def coordinates_of(
    frames: NDArray[np.floating],
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Where frames (n, 3, 3), rows tangent, bitangent, normal, lie in the cubes.

    Returns the handedness (n,), 1 for left-handed frames, which lie where the right-handed frame
    with the other bitangent does; the half turn (n,); and x, y, z (n, 3) in [-1, 1].
    """
    frames = np.asarray(frames, np.float64)
    mirrored = np.linalg.det(frames) < 0.0
    frames = frames * np.where(mirrored[:, None], (1, -1, 1), 1)[:, :, None]
    traces = np.einsum("nii,hi->nh", frames, HALF_TURNS)
    turn = traces.argmax(1)
    turned = frames * HALF_TURNS[turn][:, None, :]
    tangent, bitangent, normal = np.moveaxis(turned, 1, 0)
    ratios = np.column_stack(
        [
            bitangent[:, 2] - normal[:, 1],
            normal[:, 0] - tangent[:, 2],
            tangent[:, 1] - bitangent[:, 0],
        ]
    ) / (1.0 + np.take_along_axis(traces, turn[:, None], 1))
    return mirrored.astype(np.intp), turn, np.arctan(np.clip(ratios, -1.0, 1.0)) * (4.0 / np.pi)


def corners_of(frames: NDArray[np.floating], grid: int) -> list[tuple[NDArray, ...]]:
    """The four grid points whose tetrahedron a frame lies in: for each its weight (n,), and its
    handedness, half turn, and y, z and x of the grid (n,).

    A cell's six tetrahedra share the diagonal away from the cube's middle, on the way along which
    steps are taken along the axes in the order of the fractions. Signs and order of the axes make
    no difference, so tetrahedra of neighbouring cubes fit and nothing jumps between them.
    """
    hand, turn, coordinates = coordinates_of(frames)
    middle = grid // 2
    away = np.abs(coordinates) * middle
    corner = np.minimum(np.floor(away), middle - 1)
    fraction = away - corner
    least, second, most = np.sort(fraction, 1).T
    steps = [
        np.zeros_like(fraction),
        fraction >= most[:, None],
        fraction >= second[:, None],
        np.ones_like(fraction),
    ]
    weights = [1.0 - most, most - second, second - least, least]
    found: list[tuple[NDArray, ...]] = []
    for weight, step in zip(weights, steps, strict=True):
        point = middle + np.copysign(corner + step, coordinates)
        x, y, z = point.astype(np.intp).T
        found.append((weight, hand, turn, y, z, x))
    return found
