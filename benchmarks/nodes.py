"""What the node groups cost: nodes, fetches, compiling, memory, and EEVEE's frames beside those of
a Principled BSDF with four image textures.

A plane fills the picture under suns without shadows. A frame's time is that of many samples less
that of one, for the time around a render is larger than a frame. Then what moving a light and
turning the world take of our own: drivers and handlers, without the redraw. Mesa keeps compiled
shaders from one run to the next: clear its cache to see what compiling takes.
`python -m benchmarks.nodes`
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from statistics import median

import bpy
import numpy as np

from addon.live import follow_lights, follow_worlds
from addon.nodes.atlas import make_image
from addon.nodes.graph import Graph
from addon.nodes.kept_world import KeptWorld
from addon.nodes.material import group_of, material_from_tables, set_environment, set_lights
from addon.nodes.packed_tables import stored
from addon.render.engines import engine_id, set_engine
from addon.render.stage import add_camera, add_mesh, add_sun, new_scene
from addon.tables.environment import build_environment
from addon.tables.light_lobes import light_lobes
from addon.tables.tables import Tables

from ._report import bar, table
from ._tables import random_tables

MATERIALS = {
    "K-CTA, Corduroy: R 20x4, C 8, K 3": ((1, 8), (1, 3), (20, 4)),
    "MK-CTA, Hole: R 4x4, C 8x10, K 3x3": ((8, 10), (3, 3), (4, 4)),
}
SUNS = (1, 4, 8)
SIZES = ((160, 120), (320, 240))
SAMPLES = 5
REPEATS = 3
AT_MOST = 0.05
"""Seconds of our own work for moving a light or turning the world."""


def main() -> None:
    for name, shape in MATERIALS.items():
        tables = random_tables(*shape)
        material = material_from_tables(tables, "Model")
        plain = principled()
        print(f"{name}: {megabytes(material):.0f} MB of images; fetches {tables.fetches}")
        rows = [["suns", "nodes", "compiled in", *(f"{w}x{h}, to Principled" for w, h in SIZES)]]
        for suns in SUNS:
            cells = []
            for size in SIZES:
                with lit_plane(size, suns) as (scene, plane):
                    set_lights(material, scene)
                    plane.data.materials[0] = material
                    first = seconds(scene, 1)
                    ours = frame(scene)
                    compiled = first - seconds(scene, 1)
                    plane.data.materials[0] = plain
                    seconds(scene, 1)
                    cells.append((compiled, f"{ours / frame(scene):.1f}"))
            most = max(compiled for compiled, _ in cells)
            rows.append([str(suns), str(nodes_of(group_of(material))), f"{most:.1f} s",
                         *(ratio for _, ratio in cells)])  # fmt: skip
        print(table(rows))
        moves(tables, material)
        bpy.data.materials.remove(material)


def moves(tables: Tables, material: bpy.types.Material) -> None:
    """Our own work when a light is moved, and when the world is turned."""
    with lit_plane((16, 16), 8) as (scene, plane):
        plane.data.materials[0] = material
        set_lights(material, scene)
        mapping = turning_world(scene)
        radiance = np.random.default_rng(1).random((32, 64, 3))
        environment = build_environment(light_lobes(tables), radiance)
        set_environment(
            material, [environment], KeptWorld(radiance, scene.world.name, mapping.name)
        )
        layer = scene.view_layers[0]
        sun = next(item for item in scene.objects if item.type == "LIGHT")
        layer.update()
        taken = {}
        for what in ("moving a light", "turning the world"):
            times = []
            for step in range(9):
                if what == "moving a light":
                    sun.location.x += 0.1
                else:
                    mapping.inputs["Rotation"].default_value[2] = 0.1 * step
                begun = time.perf_counter()
                follow_lights(scene)
                follow_worlds()
                layer.update()
                times.append(time.perf_counter() - begun)
            taken[what] = median(times)
        for what, value in taken.items():
            print(
                bar(value < AT_MOST, f"{what}: {1e3 * value:.1f} ms, at most {1e3 * AT_MOST:.0f}")
            )


@contextmanager
def lit_plane(
    size: tuple[int, int], suns: int
) -> Iterator[tuple[bpy.types.Scene, bpy.types.Object]]:
    """A scene of a plane that fills the picture under suns without shadows."""
    with new_scene(size) as scene:
        plane = add_mesh(scene, "plane", principled())
        add_camera(scene, (0.0, 0.0), 1.0)
        for number in range(suns):
            sun = add_sun(scene, (40.0, 360.0 * number / suns))
            sun.data.use_shadow = False
        set_engine(scene, "eevee", 1)
        yield scene, plane


def principled() -> bpy.types.Material:
    """A Principled BSDF with colour, roughness, metal and normal from images."""
    material = bpy.data.materials.new("Principled")
    if material.node_tree is None:
        material.use_nodes = True
    g = Graph(material.node_tree)
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    rng = np.random.default_rng(2)
    for name in ("Base Color", "Roughness", "Metallic", "Normal"):
        image = make_image(name, rng.random((256, 256, 4)).astype(np.float32))
        wire = g.wire(g.node("ShaderNodeTexImage", image=image))
        if name == "Normal":
            wire = g.wire(g.node("ShaderNodeNormalMap", 1.0, wire))
        g.connect(wire, shader.inputs[name])
    return material


def turning_world(scene: bpy.types.Scene) -> bpy.types.ShaderNodeMapping:
    tree = scene.world.node_tree
    mapping: bpy.types.ShaderNodeMapping = tree.nodes.new("ShaderNodeMapping")
    return mapping


def frame(scene: bpy.types.Scene) -> float:
    """Seconds of one sample of all pixels."""
    return median(seconds(scene, SAMPLES) - seconds(scene, 1) for _ in range(REPEATS)) / (
        SAMPLES - 1
    )


def seconds(scene: bpy.types.Scene, samples: int) -> float:
    scene.render.engine = engine_id("eevee")
    scene.eevee.taa_render_samples = samples
    begun = time.perf_counter()
    bpy.ops.render.render(scene=scene.name)
    return time.perf_counter() - begun


def nodes_of(tree: bpy.types.ShaderNodeTree) -> int:
    """Nodes of a group and of those in it, each group counted once."""
    found, left = {tree}, [tree]
    while left:
        groups = (node for node in left.pop().nodes if node.type == "GROUP")
        inner = {node.node_tree for node in groups if node.node_tree is not None}
        left += inner - found
        found |= inner
    return sum(len(group.nodes) for group in found)


def megabytes(material: bpy.types.Material) -> float:
    """Of the images, as full floats."""
    packed = stored(group_of(material))
    images = [atlas.image for atlas in packed.atlases.values()]
    return sum(16 * image.size[0] * image.size[1] for image in images) / 1e6


if __name__ == "__main__":
    main()
