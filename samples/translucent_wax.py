"""Wax with dents and drops, whose light spreads some millimetres below the surface; 2 cm wide.

`python samples/translucent_wax.py OUT.blend`, or `blender -b -P samples/translucent_wax.py --
OUT.blend`. Then measure the object "Wax".
"""

import sys

import bpy
import numpy as np

SIZE, CELLS = 0.02, 160
HEIGHT = 0.0022
# How far red, green and blue light goes, in metres.
RADIUS = (0.0018, 0.0011, 0.0006)


def build() -> bpy.types.Object:
    steps = np.linspace(-0.5, 0.5, CELLS + 1)
    x, y = np.meshgrid(steps, steps)
    points = np.stack([SIZE * x, SIZE * y, HEIGHT * _relief(x, y)], -1).reshape(-1, 3)
    low = (np.arange(CELLS)[:, None] * (CELLS + 1) + np.arange(CELLS)).ravel()
    faces = np.stack([low, low + 1, low + CELLS + 2, low + CELLS + 1], -1)
    mesh = bpy.data.meshes.new("Wax")
    mesh.from_pydata(points.tolist(), [], faces.tolist(), shade_flat=False)
    mesh.materials.append(_wax())
    return bpy.data.objects.new("Wax", mesh)


def _relief(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Heights in about [-1, 1] over [-0.5, 0.5]^2 that repeat: drops, and a slow swell."""
    random = np.random.default_rng(11)
    height = 0.25 * np.sin(2 * np.pi * (x + 2 * y)) * np.cos(2 * np.pi * (2 * x - y))
    for _ in range(9):
        at, radius = random.uniform(-0.5, 0.5, 2), random.uniform(0.07, 0.15)
        dx, dy = (np.abs(d - at[i]) for i, d in enumerate((x, y)))
        across = np.hypot(np.minimum(dx, 1 - dx), np.minimum(dy, 1 - dy)) / radius
        height = np.maximum(height, 0.9 * np.sqrt(np.maximum(0.0, 1 - across**2)))
    return height


def _wax() -> bpy.types.Material:
    material = bpy.data.materials.new("Wax")
    if material.node_tree is None:  # before 5.0
        material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    for key, value in {
        "Base Color": (0.88, 0.68, 0.42, 1),
        "Subsurface Weight": 1.0,
        "Subsurface Radius": tuple(r / RADIUS[0] for r in RADIUS),
        "Subsurface Scale": RADIUS[0],
        "Roughness": 0.32,
    }.items():
        shader.inputs[key].default_value = value
    return material


if __name__ == "__main__":
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.collection.objects.link(build())
    bpy.ops.wm.save_as_mainfile(filepath=sys.argv[-1])
