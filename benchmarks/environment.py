"""Environment light from tables against integration over every pixel, and other layouts.

    python -m benchmarks.environment [FOLDER] [--only NAMES] [--worlds NAMES] [--frames N]

Blender's studio worlds light K-CTA models (medium quality) of the materials at random orientations
of the surface, one in three mirrored, from random views and at random texels. The error is the RMS
difference of radiance over its mean. The layouts are compared on the first material.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import pi
from pathlib import Path
from time import perf_counter

import bpy
import numpy as np
from numpy.typing import NDArray

from addon.datasets.dataset import Dataset
from addon.models.exr import read_picture
from addon.models.fit import compress, quality_settings
from addon.nodes.graph import Graph
from addon.nodes.turning import follow_world, turned
from addon.tables.environment import (
    GRID,
    build_environment,
    environment_vectors,
    integrate_environment,
)
from addon.tables.evaluate import light_rows, reduced_points
from addon.tables.light_lobes import LightLobes, light_lobes
from addon.tables.orientations import HALF_TURNS, coordinates_of, corners_of
from addon.tables.tables import Tables, build_tables
from addon.tables.world_picture import (
    filter_picture,
    picture_directions,
    pixel_of,
    resize_picture,
    solid_angles,
)

from ._data import arguments, materials
from ._report import bar, table

WORLDS = ("city", "courtyard", "forest", "interior", "night", "studio", "sunrise", "sunset")
COMPARED = ("city", "forest", "sunset")
LIMIT = 0.05
HALF = 2  # bytes

Vectors = NDArray[np.floating]


@dataclass(frozen=True)
class Points:
    """Random shading points: frames (n, 3, 3) and the reduced vectors there."""

    frames: NDArray[np.float64]
    reduced: NDArray[np.float32]

    def values(self, vectors: Vectors) -> NDArray[np.floating]:
        found = np.einsum("nvclr,nvlr->nc", vectors, self.reduced, optimize=True)
        return np.maximum(found, 0.0)

    def error(self, vectors: Vectors, truth: Vectors) -> float:
        wanted = self.values(truth)
        return float(np.sqrt(np.mean((self.values(vectors) - wanted) ** 2)) / wanted.mean())


def main() -> None:
    def more(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("--worlds", nargs="+", choices=WORLDS, default=list(WORLDS))
        parser.add_argument("--frames", type=int, default=200)
        parser.add_argument("--method", choices=("nsvd", "kcta", "mkcta"), default="kcta")

    options = arguments("environment", __doc__, more)
    pictures = {name: studio_world(name) for name in options.worlds}
    found = materials(options.folder, options.only)
    models = {name: tables_of(data, options.method) for name, data in found.items()}
    errors(models, pictures, options.frames)
    turning()
    first = next(iter(models))
    if len(models[first].core) == 1 and len(models[first].light) == 1:
        layouts(first, models[first], pictures, options.frames)


def studio_world(name: str) -> NDArray[np.float32]:
    folder = Path(bpy.utils.resource_path("LOCAL")) / "datafiles" / "studiolights" / "world"
    return np.maximum(read_picture(folder / f"{name}.exr"), 0.0)


def tables_of(dataset: Dataset, method: str) -> Tables:
    return build_tables(compress(dataset, method, **quality_settings(dataset, method, "MEDIUM")))


def random_points(tables: Tables, count: int) -> Points:
    rng = np.random.default_rng(0)
    frames = np.linalg.qr(rng.standard_normal((count, 3, 3)))[0]
    left = np.linalg.det(frames) < 0
    frames[left != (np.arange(count) % 3 == 0), 1] *= -1
    z = rng.uniform(0.2, 1.0, count)
    turn = rng.uniform(0.0, 2.0 * pi, count)
    level = np.sqrt(1.0 - z**2)
    view = np.column_stack([level * np.cos(turn), level * np.sin(turn), z])
    return Points(frames, reduced_points(tables, view, rng.random((count, 2))))


def errors(models: dict[str, Tables], pictures: dict[str, NDArray], count: int) -> None:
    rows = [["RMS error / mean", *pictures, "fit", "world", "table"]]
    largest: dict[str, float] = dict.fromkeys(pictures, 0.0)
    for name, tables in models.items():
        points = random_points(tables, count)
        start = perf_counter()
        lobes = light_lobes(tables)
        fitted, built, cells = perf_counter() - start, [], []
        for world, picture in pictures.items():
            start = perf_counter()
            environment = build_environment(lobes, picture)
            built.append(perf_counter() - start)
            truth = integrate_environment(tables, picture, points.frames)
            error = points.error(environment_vectors(environment, points.frames), truth)
            largest[world] = max(largest[world], error)
            cells.append(f"{error:.1%}")
        size = f"{environment.vectors.nbytes / 1e6:.1f} MB"
        rows.append([name, *cells, f"{fitted:.1f} s", f"{np.median(built):.1f} s", size])
    print(table(rows))
    good = [world for world, error in largest.items() if error <= LIMIT]
    print(bar(len(good) >= 3, f"at most {LIMIT:.0%} in {len(good)} worlds: {', '.join(good)}"))


def turning() -> None:
    """How long it takes until a material's frame has followed the world's rotation."""
    world, material = bpy.data.worlds.new("Turning"), bpy.data.materials.new("Turning")
    for item in (world, material):
        if item.node_tree is None:
            item.use_nodes = True
    mapping = world.node_tree.nodes.new("ShaderNodeMapping")
    g = Graph(material.node_tree)
    axis, *_ = turned(g, [g.combine(1.0, 0.0)] * 3, world, mapping)
    mesh = bpy.data.meshes.new("Turning")
    mesh.materials.append(material)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Turning", mesh))
    bpy.context.scene.world = world
    took = []
    for step in range(20):
        start = perf_counter()
        mapping.inputs["Rotation"].default_value = (0.0, 0.0, 0.1 * step)
        follow_world(world, mapping, axis.socket.node)
        bpy.context.view_layer.update()
        took.append(perf_counter() - start)
    followed = axis.socket.node.inputs["Rotation"].default_value[2]
    if not np.isclose(followed, 0.1 * step):
        raise SystemExit(f"the frame turned by {followed}, not by {0.1 * step}")
    milliseconds = 1000.0 * float(np.median(took))
    print(bar(milliseconds < 50.0, f"turning the world: {milliseconds:.2f} ms of drivers"))


def layouts(name: str, tables: Tables, pictures: dict[str, NDArray], count: int) -> None:
    """Ways to keep the vectors, at equal light maps, environments and points."""
    pictures = {world: pictures[world] for world in COMPARED if world in pictures}
    points, lobes = random_points(tables, count), light_lobes(tables)
    truth = {w: integrate_environment(tables, p, points.frames) for w, p in pictures.items()}
    rank, channels = tables.core.shape[2], tables.channels
    quads = channels * -(-rank // 4)
    rows = [[f"{name}: layout", "MB", "fetches", *pictures]]
    for layout, numbers, fetches, found in _layouts(tables, lobes, quads):
        cells = [
            f"{points.error(found(picture, points.frames), truth[world]):.1%}"
            for world, picture in pictures.items()
        ]
        rows.append([layout, f"{numbers * HALF / 1e6:.1f}", str(fetches), *cells])
    print(f"\n{table(rows)}")


Layout = Callable[[NDArray, NDArray], Vectors]


def _layouts(
    tables: Tables, lobes: LightLobes, quads: int
) -> Iterator[tuple[str, float, int, Layout]]:
    """Name, numbers kept for frames of both hands, RGBA fetches a point, vectors of frames."""
    numbers = 4 * quads
    for grid in (9, 13, 17, GRID, 33):
        kept = 8 * grid**3 * numbers

        def nearest(picture: NDArray, frames: NDArray, grid: int = grid) -> Vectors:
            return convolved(lobes, picture, _nearest_frames(frames, grid))

        def linear(picture: NDArray, frames: NDArray, grid: int = grid) -> Vectors:
            return environment_vectors(build_environment(lobes, picture, grid), frames)

        if grid in (17, GRID):
            yield f"cubes of {grid}^3, nearest", kept, quads, nearest
        yield f"cubes of {grid}^3, tetrahedra", kept, 4 * quads, linear
    for edge, angles in ((48, 32), (64, 64)):

        def by_normal(
            picture: NDArray, frames: NDArray, edge: int = edge, angles: int = angles
        ) -> Vectors:
            return convolved(lobes, picture, _normal_and_angle(frames, edge, angles))

        kept = 2 * edge**2 * angles * numbers
        yield f"normal {edge}^2 x angle {angles}, nearest", kept, quads, by_normal
    for order in (2, 4):

        def fourier(picture: NDArray, frames: NDArray, order: int = order) -> Vectors:
            return _fourier(lobes, picture, frames, 128, order)

        terms = 2 * order + 1
        yield (
            f"normal 128^2, Fourier series of {terms}",
            2 * 128**2 * terms * numbers,
            terms * quads,
            fourier,
        )
    for degree in (2, 4, 8):

        def harmonics(picture: NDArray, frames: NDArray, degree: int = degree) -> Vectors:
            return _harmonics(tables, picture, frames, degree)

        terms = (degree + 1) ** 2
        yield f"spherical harmonics to {degree}", terms * 3, terms * (1 + quads), harmonics
    for rank in (8, 16, 32):

        def reduced(picture: NDArray, frames: NDArray, rank: int = rank) -> Vectors:
            return _low_rank(lobes, picture, frames, rank)

        kept = 8 * GRID**3 * rank
        yield f"cubes of {GRID}^3, rank {rank}", kept, rank + rank * quads, reduced
    for step in (0.45, 0.32, 0.22):
        few = light_lobes(tables, step)

        def looked_up(picture: NDArray, frames: NDArray, few: LightLobes = few) -> Vectors:
            return convolved(few, picture, frames)

        count = len(few.centres)
        yield f"{count} lobes looked up", 128 * 256 * 4, count * (1 + quads), looked_up


def convolved(lobes: LightLobes, picture: NDArray, frames: NDArray) -> Vectors:
    """The vectors of any frames, without a table."""
    small = resize_picture(picture, 128, 256)
    filtered = filter_picture(small, lobes.sharpness).reshape(-1, 3) / pi
    seen = filtered[pixel_of(lobes.centres @ frames, 128, 256)]
    return np.einsum("nqc,qvclr->nvclr", seen, lobes.weights, optimize=True)


def _nearest_frames(frames: NDArray, grid: int) -> NDArray:
    hand, turn, coordinates = coordinates_of(frames)
    points = np.tan(np.rint((coordinates + 1) / 2 * (grid - 1)) / (grid - 1) * pi / 2 - pi / 4)
    return _frames_of(hand, turn, points)


def _frames_of(hand: NDArray, turn: NDArray, points: NDArray) -> NDArray:
    x, y, z = points.T
    rows = [
        [1 + x**2 - y**2 - z**2, 2 * (x * y + z), 2 * (x * z - y)],
        [2 * (x * y - z), 1 - x**2 + y**2 - z**2, 2 * (y * z + x)],
        [2 * (x * z + y), 2 * (y * z - x), 1 - x**2 - y**2 + z**2],
    ]
    frames = np.moveaxis(np.array(rows) / (1 + x**2 + y**2 + z**2), -1, 0)
    frames = frames * HALF_TURNS[turn][:, None, :]
    frames[hand == 1, 1] *= -1
    return frames


def _normal_and_angle(frames: NDArray, edge: int, angles: int) -> NDArray:
    normal, angle, hand = _split(frames, edge)
    return _join(normal, np.rint(angle / (2 * pi) * angles) / angles * 2 * pi, hand)


def _fourier(
    lobes: LightLobes, picture: NDArray, frames: NDArray, edge: int, order: int
) -> Vectors:
    normal, angle, hand = _split(frames, edge)
    steps = 24
    at = [_join(normal, np.full(len(normal), 2 * pi * i / steps), hand) for i in range(steps)]
    spectrum = np.fft.rfft([convolved(lobes, picture, f) for f in at], axis=0)[: order + 1]
    phases = np.exp(1j * np.multiply.outer(np.arange(order + 1), angle)) / steps
    phases[1:] *= 2
    return np.einsum("kn,kn...->n...", phases, spectrum).real


def _split(frames: NDArray, edge: int) -> tuple[NDArray, NDArray, NDArray]:
    """The normals on an octahedral map, rounded to texels, the tangents' angles and handedness."""
    tangent, _, normal = np.moveaxis(frames, 1, 0)
    flat = normal / np.abs(normal).sum(1)[:, None]
    sign = np.where(flat[:, :2] < 0, -1.0, 1.0)
    folded = (1 - np.abs(flat[:, 1::-1])) * sign
    square = np.where(flat[:, 2:] < 0, folded, flat[:, :2])
    square = (np.floor((square + 1) / 2 * edge) + 0.5) / edge * 2 - 1
    height = 1 - np.abs(square).sum(1)
    sign = np.where(square < 0, -1.0, 1.0)
    folded = (1 - np.abs(square[:, ::-1])) * sign
    rounded = np.column_stack([np.where(height[:, None] < 0, folded, square), height])
    rounded /= np.linalg.norm(rounded, axis=1)[:, None]
    first, second = _reference(rounded)
    angle = np.arctan2((tangent * second).sum(1), (tangent * first).sum(1))
    return rounded, angle, np.linalg.det(frames) < 0


def _reference(normal: NDArray) -> tuple[NDArray, NDArray]:
    first = np.cross(np.where(np.abs(normal[:, 2:]) > 0.9, (1.0, 0, 0), (0, 0, 1.0)), normal)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(normal, first)


def _join(normal: NDArray, angle: NDArray, hand: NDArray) -> NDArray:
    first, second = _reference(normal)
    tangent = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    bitangent = np.cross(normal, tangent) * np.where(hand, -1, 1)[:, None]
    return np.stack([tangent, bitangent, normal], 1)


def _harmonics(tables: Tables, picture: NDArray, frames: NDArray, degree: int) -> Vectors:
    """Light rows as polynomials on the sphere, which spherical harmonics to that degree span."""
    height, width = 64, 128
    sphere = picture_directions(height, width).reshape(-1, 3)
    angles = np.repeat(solid_angles(height, width), width)
    basis, triangle = np.linalg.qr(_polynomials(sphere, degree) * np.sqrt(angles)[:, None])
    rows = light_rows(tables, sphere).transpose(0, 3, 1, 2, 4)
    flat = rows.reshape(len(rows), -1) * np.sqrt(angles)[:, None]
    weights = np.linalg.solve(triangle, basis.T @ flat)
    power = resize_picture(picture, height, width).reshape(-1, 3) * angles[:, None] / pi
    seen = np.array([_polynomials(sphere @ f.T, degree).T @ power for f in frames])
    return np.einsum("nqc,qvclr->nvclr", seen, weights.reshape(-1, *rows.shape[1:]), optimize=True)


def _polynomials(directions: NDArray, degree: int) -> NDArray:
    x, y, z = directions.T
    return np.column_stack(
        [
            x**a * y**b * z**c
            for c in (0, 1)
            for a in range(degree + 1 - c)
            for b in range(degree + 1 - c - a)
        ]
    )


def _low_rank(lobes: LightLobes, picture: NDArray, frames: NDArray, rank: int) -> Vectors:
    """The table's right-handed half on its first singular vectors."""
    environment = build_environment(lobes, picture)
    vectors = environment.vectors.astype(np.float32)
    flat = np.moveaxis(vectors, (1, 3, 9), (-3, -2, -1)).reshape(-1, 12 * vectors.shape[3])
    _, axes = np.linalg.eigh(flat.T @ flat)
    axes = axes[:, -rank:]
    kept = (flat @ axes) @ axes.T
    shape = np.moveaxis(vectors, (1, 3, 9), (-3, -2, -1)).shape
    back = np.moveaxis(kept.reshape(shape), (-3, -2, -1), (1, 3, 9))
    total = 0.0
    for weight, hand, turn, y, z, x in corners_of(frames, environment.grid):
        corner = np.moveaxis(back[:, :, :, :, hand, turn, y, z, x], 4, 0)
        total = total + weight[:, None, None, None, None, None] * corner
    total = total.reshape(*total.shape[:4], -1)[..., : environment.rank]
    return total * environment.scale


if __name__ == "__main__":
    main()
