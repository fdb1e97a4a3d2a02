"""Pictures of an object: in Cycles with the real geometry, and on the smooth mesh on the CPU.

Both share the camera, the lights and the UV map. On the CPU a picture begins with a *view* of the
smooth mesh: UV coordinates, taken from Cycles' own UV pass, and the frames that go with them. A
value is that of the dataset, or of a model's tables, at the coordinates, times the lights; the
object's shadows on itself and light from one part of it to another are left out, as in the
viewport.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from addon.datasets.dataset import Dataset
from addon.measure.cycles import render, set_up_cycles
from addon.models.clustered_tucker import ClusteredTucker
from addon.models.interpolation import horizon_fade, raise_to_lowest, thin_plate_weights
from addon.render.stage import add_camera, add_mesh, new_scene, unit
from addon.tables.evaluate import light_rows, taps
from addon.tables.parabolic import texel_of
from addon.tables.tables import Tables

from ._lights import Lights
from ._real_geometry import Object, add_real_geometry

ROOT = Path(__file__).resolve().parents[1]
SPAN = 2.3
"""The picture's width, in half widths of the object."""

SUBPIXELS = 2
"""Samples of the smooth mesh along a pixel's side."""

FRAMES = 64
"""Along each side of the UV map, where the light of a world is summed."""

FEW = 16
"""Lights that are summed for each point."""

CHUNK = 8192

Pixels = NDArray[np.float32]


@dataclass(frozen=True)
class Shot:
    """What all pictures of one object share: its camera at (theta, phi) in degrees."""

    object: str
    across: int
    size: int
    camera: tuple[float, float]


def build(scene: str) -> bpy.types.ID:
    """What is to be measured of a scene of samples/, in a file of its own."""
    spec = importlib.util.spec_from_file_location(scene, ROOT / "samples" / f"{scene}.py")
    module = importlib.util.module_from_spec(spec)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    spec.loader.exec_module(module)
    item = module.build()
    if isinstance(item, bpy.types.Object):
        bpy.context.scene.collection.objects.link(item)
        bpy.context.view_layer.update()
    return item


@contextmanager
def real_scene(
    item: bpy.types.ID, dataset: Dataset, shot: Shot, samples: int
) -> Iterator[bpy.types.Scene]:
    """The real geometry before the camera, for Cycles as the dataset was measured; no light."""
    shape = Object.of(shot.object, shot.across, dataset.patch_size)
    with new_scene((shot.size, shot.size)) as scene:
        set_up_cycles(scene, samples, dataset.source["measurement"]["bounces"])
        add_real_geometry(scene, item, shape, unit(shot.camera))
        place_camera(scene, shot, shape.unit)
        yield scene


def remove_lights(scene: bpy.types.Scene) -> None:
    """What addon.render.stage and _lights put into a scene."""
    for light in [one for one in scene.objects if one.type == "LIGHT"]:
        bpy.data.objects.remove(light)
    scene.world = None


def take(scene: bpy.types.Scene) -> Pixels:
    """A picture (y, x, 4) of a scene, linear, with other seeds than a dataset's."""
    return render(scene, 2**20)["Combined"]


def place_camera(scene: bpy.types.Scene, shot: Shot, scale: float) -> None:
    """For an object `scale` times as large as those of the stage."""
    if scene.camera:
        bpy.data.objects.remove(scene.camera)
    camera = add_camera(scene, shot.camera, SPAN * scale)
    camera.matrix_world.translation *= scale
    camera.data.clip_start, camera.data.clip_end = 0.1 * scale, 100.0 * scale


@dataclass(frozen=True)
class View:
    """The smooth mesh as the camera sees it, in n subpixels.

    places  (n,) into the flattened (y, x) subpixels
    uv      (n, 2), 1 along a patch
    whole   (n, 2), 1 along the object
    frames  (n, 3, 3) tangent, bitangent and normal
    view    (n, 3) the direction to the camera in the frames
    size    pixels along the picture's side, and subpixels along a pixel's
    """

    shape: Object
    places: NDArray[np.intp]
    uv: NDArray[np.float64]
    whole: NDArray[np.float64]
    frames: NDArray[np.float64]
    view: NDArray[np.float64]
    size: tuple[int, int]

    def picture(self, values: NDArray) -> Pixels:
        """Values (n, channels) as a picture (y, x, channels), black where there is no object."""
        fine = np.zeros((np.prod(self.size) ** 2, values.shape[1]), np.float32)
        fine[self.places] = values
        return fine.reshape(*self.size, *self.size, -1).mean((1, 3))

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Pixels (y, x) that the smooth mesh fills."""
        return self.picture(np.ones((len(self.uv), 1)))[..., 0] == 1.0


def look_at(dataset: Dataset, shot: Shot, subpixels: int = SUBPIXELS) -> View:
    """What a camera sees of the smooth mesh."""
    shape = Object.of(shot.object, shot.across, dataset.patch_size)
    side = shot.size * subpixels
    with new_scene((side, side)) as scene:
        set_up_cycles(scene, 1, 0)
        scene.cycles.filter_width = 0.01  # the middle of each subpixel
        scene.view_layers[0].use_pass_uv = True
        material = bpy.data.materials.new("Smooth")
        add_mesh(scene, shot.object, material, shot.across)
        place_camera(scene, shot, 1.0)
        passes = render(scene, 0)
        bpy.data.materials.remove(material)
    covered = passes["Combined"][..., 3].ravel() > 0.5
    uv = np.stack([passes[f"UV.{axis}"].ravel()[covered] for axis in "UV"], -1).astype(float)
    whole = uv / shape.repeat
    frames = shape.frame(*whole.T)
    view = frames @ unit(shot.camera)
    return View(shape, np.flatnonzero(covered), uv, whole, frames, view, (shot.size, subpixels))


def of_dataset(dataset: Dataset, view: View, lights: list[Lights]) -> list[Pixels]:
    """Pictures of the uncompressed samples under each of `lights`.

    Thin-plate splines between the measured directions, as for the models (K-CTA, Section 6.3.2),
    with no map of directions in between; bilinear between texels.
    """

    def rows(light: NDArray) -> NDArray[np.float32]:
        weights = thin_plate_weights(dataset.light, light)
        weights *= horizon_fade(dataset.light, light)[:, None]
        return weights.astype(np.float32)

    of_view = thin_plate_weights(dataset.view, view.view).astype(np.float32)
    lit = [_over_frames(view, one, rows)(slice(None)) for one in lights]
    values = [np.zeros((len(view.uv), 3), np.float32) for _ in lights]
    height, width = dataset.shape[2:4]
    texels = np.ascontiguousarray(
        np.asarray(dataset.samples).reshape(*dataset.shape[:2], -1, 3).transpose(2, 3, 0, 1)
    )
    for weight, y, x in taps(view.uv, (height, width)):
        texel = y * width + x
        order = np.argsort(texel, kind="stable")
        for points in np.split(order, np.flatnonzero(np.diff(texel[order])) + 1):
            block = texels[texel[points[0]]].astype(np.float32)  # (channel, light, view)
            weighted = (weight[points, None] * of_view[points]).astype(np.float32)
            seen = block @ weighted.T
            for rows_of, found in zip(lit, values, strict=True):
                found[points] += np.einsum("pcl,clp->pc", rows_of[points], seen)
    return [view.picture(np.maximum(found, 0.0)) for found in values]


def of_tables(
    tables: Tables, view: View, lights: list[Lights], rows: ViewRows | None = None
) -> list[Pixels]:
    """Pictures of a model by its tables, which every evaluator reads, under each of `lights`.

    The sum over the lights comes before the core, whose values are then read once: the same as
    addon.tables.evaluate.evaluate_points for one light after the other. `rows` are read from the
    tables' maps where they are not given.
    """
    lit = [_over_frames(view, one, lambda light: light_rows(tables, light)) for one in lights]
    values = [np.zeros((len(view.uv), tables.channels), np.float32) for _ in lights]
    of_view = rows or mapped_rows(tables, view)
    for first in range(0, len(view.uv), CHUNK):
        part = slice(first, first + CHUNK)
        of_lights = [points(part) for points in lit]  # (n, channel, C_light, owners, R_light)
        corners = taps(view.uv[part], tables.core.shape[4:6])
        for k, clusters in enumerate(of_view.clusters[:, part]):
            own = clusters if of_lights[0].shape[3] > 1 else 0
            for c_light in range(len(tables.core)):
                owner = min(c_light, len(of_view.coefficients) - 1)
                coefficients = of_view.coefficients[owner, k, :, part]
                reduced = sum(
                    weight[:, None].astype(np.float32)
                    * np.einsum(
                        "nrqe,qne->nr", tables.core[c_light, clusters, :, :, y, x], coefficients
                    )
                    for weight, y, x in corners
                )
                for found, light in zip(values, of_lights, strict=True):
                    of_light = light[np.arange(len(clusters)), :, c_light, own]
                    found[part] += np.einsum("ncr,nr->nc", of_light, reduced)
    return [view.picture(np.maximum(found, 0.0)) for found in values]


@dataclass(frozen=True)
class ViewRows:
    """The clusters (K, n) of n points' views and their coefficients (owners, K, quads, n, 4)."""

    clusters: NDArray[np.uint32]
    coefficients: NDArray[np.float32]


def mapped_rows(tables: Tables, view: View) -> ViewRows:
    """As the evaluators read them, from the texel nearest to the view."""
    column, row = texel_of(view.view, tables.size).T
    return ViewRows(tables.view_index[:, row, column], tables.view[:, :, :, row, column])


def three_views(model: ClusteredTucker, view: View) -> ViewRows:
    """Linear between three measured views, as the K-CTA paper draws CTA (Section 6.4): of a view's
    triangle in the Delaunay triangulation of the measured ones, where that has one, which is
    continuous as sets of three nearest are not."""
    from scipy.spatial import Delaunay

    measured = np.asarray(model.dataset["view"])
    places, wanted = (
        d[:, :2] / (1.0 + d[:, 2:]) for d in (measured, raise_to_lowest(measured, view.view))
    )
    found = Delaunay(places)
    wanted = _into_hull(places[found.convex_hull], wanted, found.find_simplex(wanted) < 0)
    triangle = found.find_simplex(wanted, tol=1e-6)
    matrix = found.transform[triangle]
    two = np.einsum("nij,nj->ni", matrix[:, :2], wanted - matrix[:, 2])
    weights = np.clip(np.column_stack([two, 1.0 - two.sum(1)]), 0.0, None)
    weights /= weights.sum(1, keepdims=True)
    corners = found.simplices[triangle]  # (n, 3)
    rows = model.bases["view"][0, corners, 0] * weights[..., None]  # (n, 3, R)
    rows = np.pad(rows, ((0, 0), (0, 0), (0, -rows.shape[-1] % 4)))
    coefficients = rows.reshape(*rows.shape[:2], -1, 4).transpose(1, 2, 0, 3)[None]
    return ViewRows(
        model.members["view"][corners, 0].T.astype(np.uint32), coefficients.astype(np.float32)
    )


def _into_hull(edges: NDArray, points: NDArray, outside: NDArray[np.bool_]) -> NDArray:
    """Points (n, 2), those outside moved to the nearest one on the edges (m, 2, 2) of a hull."""
    moved = points.copy()
    start, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    away = points[outside][:, None] - start
    share = np.clip(np.sum(away * along, -1) / np.sum(along**2, -1), 0.0, 1.0)
    nearest = start + share[..., None] * along  # (n, m, 2)
    edge = np.linalg.norm(points[outside][:, None] - nearest, axis=-1).argmin(1)
    moved[outside] = nearest[np.arange(len(edge)), edge]
    return moved


def _over_frames(view: View, lights: Lights, rows: Callable) -> Callable[[slice], NDArray]:
    """The sum over the lights of colour times rows(light in the frame), at a part of the points.

    rows(light (n, 3)) gives (n, ...) for every colour, or (n, 3, ...). Of many lights it is summed
    on a grid over the UV map, and bilinear between.
    """

    def summed(frames: NDArray) -> NDArray[np.float32]:
        found = None
        for direction, colour in zip(lights.directions, lights.irradiance, strict=True):
            local = frames @ direction
            up = np.flatnonzero(local[:, 2] > 0.0)
            some = rows(local[up]) if len(up) else rows(np.array([(0.0, 0.0, 1.0)]))[:0]
            if some.ndim == 2:
                some = np.repeat(some[:, None], 3, 1)
            if found is None:
                found = np.zeros((len(frames), *some.shape[1:]), np.float32)
            found[up] += colour.reshape(3, *(1,) * (some.ndim - 2)).astype(np.float32) * some
        return found

    if len(lights.directions) <= FEW:
        return lambda part: summed(view.frames[part])
    steps = np.arange(FRAMES + 1) / FRAMES
    u, v = (axis.ravel() for axis in np.meshgrid(steps, steps))
    grid = summed(view.shape.frame(u, np.clip(v, 1e-3, 1 - 1e-3)))  # a pole has no tangent

    def between(part: slice) -> NDArray[np.float32]:
        place = np.clip(view.whole[part] * FRAMES, 0, FRAMES - 1e-6)
        corner = np.floor(place).astype(int)
        along = (place - corner).astype(np.float32)
        found = np.zeros((len(place), *grid.shape[1:]), np.float32)
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
            weight = np.abs(1 - dx - along[:, 0]) * np.abs(1 - dy - along[:, 1])
            index = (corner[:, 1] + dy) * (FRAMES + 1) + corner[:, 0] + dx
            found += weight.reshape(-1, *(1,) * (grid.ndim - 1)) * grid[index]
        return found

    return between
