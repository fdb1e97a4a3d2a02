"""Light taken from the scene in EEVEE by Shader to RGB: what several ways make of shadows.

    python -m benchmarks.scene_light [FOLDER] [--only NAMES]

A flat patch lies under balls that shade it from one light each. The reference is the sum over the
lights of the material's value times the light, times its visibility as EEVEE draws it on a white
diffuser under that light alone. The error is the RMS difference of radiance over its mean, on the
pixels that any shadow touches; K-CTA models of medium quality.

"Receive Shadows" is the material in EEVEE. The other ways are worked out from the same visibilities
with lobes that are exact, so they lack EEVEE's own errors. Then nodes, compiling and frames.
out/bench/scene_light.png: a cloth without shadows, with them, and a white one in EEVEE.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import pi

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from addon.models.fit import compress, quality_settings
from addon.nodes.graph import Graph
from addon.nodes.material import group_of, material_from_tables, set_lights
from addon.render.engines import render_pixels, set_engine
from addon.render.stage import add_camera, add_mesh, new_scene, unit
from addon.tables.evaluate import light_rows, reduced_points
from addon.tables.parabolic import texel_directions
from addon.tables.tables import Tables, build_tables

from ._data import OUT, arguments, materials
from ._report import table
from .nodes import frame, nodes_of, principled, seconds
from .recipes.sheet import write_png

PIXELS = 128
SPAN = 0.6
VIEW = (50.0, 90.0)
COUNTS = (1, 2, 4)


@dataclass(frozen=True)
class Light:
    """A sun or point at (theta, phi) in degrees, whose colour a white diffuser reads head-on in the
    middle of the patch."""

    kind: str
    at: tuple[float, float]
    colour: tuple[float, float, float]
    distance: float = 2.0


WHITE = (0.9, 0.85, 0.8)
SCENES = {
    "one sun": [Light("SUN", (40, 0), WHITE)],
    "two suns": [Light("SUN", (40, 0), WHITE), Light("SUN", (55, 200), (0.2, 0.3, 0.6))],
    "sun, two points": [
        Light("SUN", (40, 0), (0.5, 0.45, 0.4)),
        Light("POINT", (35, 190), (0.15, 0.3, 0.6)),
        Light("POINT", (60, 270), (0.5, 0.2, 0.1), 1.5),
    ],
    "two white suns 25 degrees apart": [
        Light("SUN", (40, -20), WHITE),
        Light("SUN", (40, 20), WHITE),
    ],
}


def main() -> None:
    options = arguments("scene_light", __doc__)
    first = None
    for name, dataset in materials(options.folder, options.only).items():
        tables = build_tables(compress(dataset, "kcta", **quality_settings(dataset, "kcta")))
        first = first or tables
        rows = [[name, *WAYS, "Receive Shadows"]]
        for scene, lights in SCENES.items():
            rows.append([scene, *(f"{100 * error:.1f} %" for error in errors(tables, lights))])
        print(table(rows))
    write_png(cloth(first), OUT / "scene_light.png")
    costs(first)


# --- error ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Points:
    """Shading points of the patch: for each light its direction (n, lights, 3), its radiance and
    what arrives of it (n, lights, 3); the reduced vectors there."""

    tables: Tables
    directions: NDArray[np.float64]
    radiance: NDArray[np.float64]
    visible: NDArray[np.float64]
    reduced: NDArray[np.float32]

    def values(self, rows: NDArray[np.floating]) -> NDArray[np.float64]:
        found = np.einsum("nclvr,nvlr->nc", rows, self.reduced, optimize=True)
        return np.maximum(found, 0.0)

    def value(self, direction: NDArray[np.floating]) -> NDArray[np.float64]:
        """The material's values for one light at each point."""
        return self.values(light_rows(self.tables, direction))

    def lit(self, power: NDArray[np.floating]) -> NDArray[np.float64]:
        """The sum over the lights of values times (n, lights, 3)."""
        return sum(
            self.value(self.directions[:, number]) * power[:, number]
            for number in range(power.shape[1])
        )


def errors(tables: Tables, lights: list[Light]) -> list[float]:
    points, seen, touched = measured(tables, lights)
    truth = points.lit(points.radiance * points.visible)
    found = [*(way(points) for way in WAYS.values()), seen]
    return [
        float(np.sqrt(np.mean((picture - truth)[touched] ** 2)) / truth[touched].mean())
        for picture in found
    ]


def measured(
    tables: Tables, lights: list[Light]
) -> tuple[Points, NDArray[np.float64], NDArray[np.bool_]]:
    """The points of the picture, the material's picture, and which pixels a shadow touches."""
    with patch_scene() as (scene, plane, camera):
        items = [add_light(scene, light) for light in lights]
        visible = []
        plane.data.materials[0] = white()
        for item in items:
            for other in items:
                other.hide_render = other != item
            pictures = []
            for shadows in (True, False):
                item.data.use_shadow = shadows
                pictures.append(render_pixels(scene).reshape(-1, 3))
            item.data.use_shadow = True
            visible.append(pictures[0].sum(-1) / np.maximum(pictures[1].sum(-1), 1e-6))
        for item in items:
            item.hide_render = False
        material = material_from_tables(tables, "Model")
        plane.data.materials[0] = material
        set_lights(material, scene, shadows=True)
        seen = render_pixels(scene).reshape(-1, 3)
        right, up, towards = np.array(camera.matrix_world.to_3x3()).T
    steps = SPAN * ((np.arange(PIXELS) + 0.5) / PIXELS - 0.5)
    origin = (steps[None, :, None] * right + steps[:, None, None] * up).reshape(-1, 3)
    places = origin - towards * (origin[:, 2:] / towards[2])
    directions, radiance = [], []
    for light in lights:
        towards_light = np.tile(unit(light.at), (len(places), 1))
        power = np.tile(np.array(light.colour), (len(places), 1))
        if light.kind == "POINT":
            towards_light = unit(light.at) * light.distance - places
            square = (towards_light**2).sum(-1, keepdims=True)
            power = power * light.distance**2 / square
            towards_light = towards_light / np.sqrt(square)
        directions.append(towards_light)
        radiance.append(power)
    views = np.tile(unit(VIEW), (len(places), 1))
    visibility = np.stack(visible, 1)
    points = Points(
        tables,
        np.stack(directions, 1),
        np.stack(radiance, 1),
        visibility[..., None],
        reduced_points(tables, views, places[:, :2] + 0.5),
    )
    return points, seen, (visibility < 0.9).any(1)


@contextmanager
def patch_scene(
    pixels: int = PIXELS,
) -> Iterator[tuple[bpy.types.Scene, bpy.types.Object, bpy.types.Object]]:
    """A plane of one patch that fills the picture, seen from the side: scene, plane, camera."""
    with new_scene((pixels, pixels)) as scene:
        black(scene)
        plane = add_mesh(scene, "plane", white())
        camera = add_camera(scene, VIEW, SPAN)
        set_engine(scene, "eevee", 16)
        scene.eevee.use_shadows = True
        scene.render.filter_size = 0.0
        yield scene, plane, camera


def black(scene: bpy.types.Scene) -> None:
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)


def add_light(scene: bpy.types.Scene, light: Light, ball: float = 0.12) -> bpy.types.Object:
    """A light of some size, and a ball in its way."""
    data = bpy.data.lights.new(light.kind, light.kind)
    data.color = light.colour
    data.energy = pi
    if light.kind == "SUN":
        data.angle = 0.02
    else:
        data.energy = 4.0 * pi**2 * light.distance**2
        data.shadow_soft_size = 0.02 * light.distance
    item = bpy.data.objects.new(light.kind, data)
    towards = Vector(unit(light.at))
    item.location = towards * light.distance
    item.rotation_mode = "QUATERNION"
    item.rotation_quaternion = towards.to_track_quat("Z", "Y")
    scene.collection.objects.link(item)
    shade = add_mesh(scene, "sphere", white())
    shade.location, shade.scale = 1.1 * towards, (ball,) * 3
    return item


def white() -> bpy.types.Material:
    material = bpy.data.materials.new("White")
    if material.node_tree is None:  # before 5.0
        material.use_nodes = True
    material.node_tree.nodes.clear()
    g = Graph(material.node_tree)
    diffuse = g.node("ShaderNodeBsdfDiffuse", (1.0, 1.0, 1.0, 1.0))
    g.node("ShaderNodeOutputMaterial", g.wire(diffuse))
    return material


# --- other ways ----------------------------------------------------------------------------------


def no_shadows(points: Points) -> NDArray[np.float64]:
    return points.lit(points.radiance)


def dominant_light(points: Points) -> NDArray[np.float64]:
    """Six diffuse lobes give the vector irradiance; the model is evaluated once along it."""
    power = points.radiance * points.visible
    vectors = np.einsum("nlk,nlc->nck", points.directions, power)
    along = vectors.sum(1)
    along /= np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    strength = np.maximum(np.einsum("nck,nk->nc", vectors, along), 0.0)
    return points.value(along) * strength


def one_ratio(points: Points) -> NDArray[np.float64]:
    """One diffuse lobe with shadows over the same without, for each channel."""
    cosine = np.maximum(points.directions[..., 2:], 0.0)
    dimmed = (points.radiance * points.visible * cosine).sum(1)
    full = (points.radiance * cosine).sum(1)
    return no_shadows(points) * dimmed / np.maximum(full, 1e-9)


def on_lobes(
    count: int, lobe: Callable[[NDArray, NDArray], NDArray]
) -> Callable[[Points], NDArray[np.float64]]:
    """The light basis projected on lobes of fixed directions, by least squares."""

    def way(points: Points) -> NDArray[np.float64]:
        centres = spread(count)
        over = texel_directions(64).reshape(-1, 3)
        over = over[over[:, 2] > 0.0]
        rows = light_rows(points.tables, over)
        weights = np.linalg.lstsq(lobe(over, centres), rows.reshape(len(over), -1), rcond=1e-3)[0]
        weights = weights.reshape(count, *rows.shape[1:])
        power = points.radiance * points.visible
        seen = np.einsum("nlj,nlc->njc", lobe(points.directions, centres), power)
        return points.values(np.einsum("njc,jclvr->nclvr", seen, weights, optimize=True))

    return way


def spread(count: int) -> NDArray[np.float64]:
    """Directions evenly over the hemisphere (a spiral)."""
    z = 1.0 - (np.arange(count) + 0.5) / count
    turn = pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    level = np.sqrt(1.0 - z**2)
    return np.column_stack([level * np.cos(turn), level * np.sin(turn), z])


def diffuse(directions: NDArray, centres: NDArray) -> NDArray:
    return np.maximum(directions @ centres.T, 0.0)


def glossy(directions: NDArray, centres: NDArray) -> NDArray:
    """About as wide as the lobes are apart."""
    return np.exp(1.2 * len(centres) * (directions @ centres.T - 1.0))


WAYS: dict[str, Callable[[Points], NDArray[np.float64]]] = {
    "no shadows": no_shadows,
    "dominant light": dominant_light,
    "one ratio": one_ratio,
    "9 diffuse lobes": on_lobes(9, diffuse),
    "9 glossy lobes": on_lobes(9, glossy),
    "25 glossy lobes": on_lobes(25, glossy),
}


# --- cost ----------------------------------------------------------------------------------------


def costs(tables: Tables) -> None:
    """Nodes, compiling, and the frame beside that of a Principled BSDF, all under shadows."""
    print(table([["suns", "nodes", "compiled in", "frame, without", "with", "Principled"]]))
    material, plain = material_from_tables(tables, "Model"), principled()
    for count in COUNTS:
        with patch_scene(64) as (scene, plane, _):
            for number in range(count):
                add_light(scene, Light("SUN", (40.0, 360.0 * number / count), WHITE))
            cells = []
            for shadows in (False, True):
                set_lights(material, scene, shadows)
                plane.data.materials[0] = material
                compiled = seconds(scene, 1) - seconds(scene, 1)
                cells.append(f"{1e3 * frame(scene):.0f} ms")
            plane.data.materials[0] = plain
            seconds(scene, 1)
            nodes = nodes_of(group_of(material))
            cells = [str(count), str(nodes), f"{compiled:.1f} s", *cells]
            print(table([[*cells, f"{1e3 * frame(scene):.0f} ms"]]), flush=True)


def cloth(tables: Tables) -> NDArray[np.float32]:
    """Three pictures side by side (height, width, 3)."""
    lights = [Light("SUN", (35, -30), WHITE), Light("SUN", (50, 200), (0.25, 0.4, 0.8))]
    with new_scene((240, 240)) as scene:
        black(scene)
        material = material_from_tables(tables, "Model")
        item = add_mesh(scene, "cloth", material, 6.0)
        add_camera(scene, (40.0, 270.0), 2.1)
        for light in lights:
            shade = add_light(scene, light, 0.0)
            shade.location *= 2.0
        ball = add_mesh(scene, "sphere", white())
        ball.location, ball.scale = (0.1, -0.2, 0.75), (0.22,) * 3
        set_engine(scene, "eevee", 16)
        scene.eevee.use_shadows = True
        pictures = []
        for shadows in (False, True):
            set_lights(material, scene, shadows)
            pictures.append(render_pixels(scene))
        item.data.materials[0] = white()
        pictures.append(render_pixels(scene))
    return np.concatenate(pictures, 1)


if __name__ == "__main__":
    main()
