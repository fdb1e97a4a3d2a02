"""The extension without a window, as a farm runs it: import, compress, material, two pictures.

    blender -b --python-exit-code 1 --python tests/gui/batch.py -- BTF FOLDER

FOLDER takes the dataset, the model, `eevee.png` and `cycles.png`; status 1 is a failed check.
"""

import sys
from math import pi, radians
from pathlib import Path

import bpy
import numpy as np

BTF, FOLDER = (Path(argument).resolve() for argument in sys.argv[sys.argv.index("--") + 1 :][:2])
ENGINES = {"eevee": ("BLENDER_EEVEE", "BLENDER_EEVEE_NEXT"), "cycles": ("CYCLES",)}


def main() -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_torus_add(major_segments=96, minor_segments=48)
    bpy.ops.object.shade_smooth()
    torus = bpy.context.object
    bpy.ops.object.light_add(type="SUN", rotation=(radians(35), radians(25), 0))
    bpy.context.object.data.energy = pi
    bpy.ops.object.camera_add(location=(0, -3.4, 2.6), rotation=(radians(52), 0, 0))
    scene.camera = bpy.context.object
    bpy.ops.object.select_all(action="DESELECT")
    torus.select_set(True)

    dataset, model = FOLDER / "sample.nacre", FOLDER / "sample.exr"
    assert bpy.ops.nacre.import_btf(filepath=str(BTF), destination=str(dataset)) == {"FINISHED"}
    scene.nacre.output = str(model)
    assert bpy.ops.nacre.compress() == {"FINISHED"}
    assert bpy.ops.nacre.create_material() == {"FINISHED"}
    assert model.is_file() and torus.active_material.nacre.model
    torus.active_material.node_tree.nodes["Repeat"].inputs[1].default_value = (12, 4, 1)

    scene.render.resolution_x, scene.render.resolution_y = 480, 360
    scene.cycles.samples = scene.eevee.taa_render_samples = 8
    pictures = [render(scene, engine) for engine in ENGINES]
    difference = np.abs(pictures[0] - pictures[1]).mean()
    print(f"PASSED: mean {pictures[0].mean():.3f}, engines differ by {difference:.4f}")
    assert pictures[0].mean() > 0.02
    assert difference < 0.02 * pictures[0].mean() + 0.005


def render(scene: bpy.types.Scene, engine: str) -> np.ndarray:
    for name in ENGINES[engine]:
        try:
            scene.render.engine = name
            break
        except TypeError:  # the other release's name
            continue
    scene.render.filepath = str(FOLDER / f"{engine}.png")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(-1, 4)[:, :3]


main()
