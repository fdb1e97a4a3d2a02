"""A plain weave of yarns, each of twisted hair strands, that repeats after 1.2 cm.

`python samples/woven_hair.py OUT.blend`, or `blender -b -P samples/woven_hair.py -- OUT.blend`.
Then measure the collection "Weave" at a size of 0.012 m.
"""

import sys

import bpy
import numpy as np

SIZE, YARNS = 0.012, 4  # an even number, for the weave to repeat
STRANDS, POINTS, TURNS = 24, 97, 6
STRAND_RADIUS, YARN_RADIUS = 0.16e-3, 0.95e-3
WARP, WEFT = (0.50, 0.36, 0.20), (0.08, 0.16, 0.34)


def build() -> bpy.types.Collection:
    random = np.random.default_rng(4)
    collection = bpy.data.collections.new("Weave")
    for name, straight, colour in (("Warp", True, WARP), ("Weft", False, WEFT)):
        strands = np.concatenate([_yarn(number, straight, random) for number in range(YARNS)])
        curves = _hair(name, strands, _fibre(name, colour))
        collection.objects.link(bpy.data.objects.new(name, curves))
    return collection


def _yarn(number: int, straight: bool, random: np.random.Generator) -> np.ndarray:
    """Strands (STRANDS, POINTS, 3) twisted round an axis that waves over and under the others."""
    along = np.linspace(-0.5, 0.5, POINTS)
    pitch = SIZE / YARNS
    # Whole waves and whole turns, so that a yarn meets itself in the next patch.
    wave = np.cos(np.pi * (YARNS * (along + 0.5) - 0.5 + number + straight))
    turn = 2 * np.pi * (random.uniform(size=(STRANDS, 1)) + TURNS * along)
    radius = YARN_RADIUS * np.sqrt((np.arange(STRANDS) + 0.5) / STRANDS)[:, None]
    across = (number + 0.5) * pitch - SIZE / 2 + 1.2 * radius * np.cos(turn)
    up = 0.75 * YARN_RADIUS * wave + 0.7 * radius * np.sin(turn)
    forward = np.broadcast_to(SIZE * along, across.shape)
    return np.stack([across, forward, up] if straight else [forward, across, up], -1)


def _hair(name: str, strands: np.ndarray, material: bpy.types.Material) -> bpy.types.Curves:
    curves = bpy.data.hair_curves.new(name)
    curves.add_curves([strands.shape[1]] * len(strands))
    points = strands.astype(np.float32).ravel()
    curves.attributes["position"].data.foreach_set("vector", points)
    layers = curves.attributes
    radius = layers.get("radius") or layers.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", np.full(len(points) // 3, STRAND_RADIUS, np.float32))
    curves.materials.append(material)
    return curves


def _fibre(name: str, colour: tuple[float, float, float]) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # before 5.0
        material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*colour, 1)
    shader.inputs["Roughness"].default_value = 0.45
    shader.inputs["Sheen Weight"].default_value = 0.3
    return material


if __name__ == "__main__":
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.collection.children.link(build())
    bpy.ops.wm.save_as_mainfile(filepath=sys.argv[-1])
