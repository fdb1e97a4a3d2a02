"""What the node groups of a sparse model cost in EEVEE and Cycles, by the number of coefficients.

Beside EEVEE's frames of a Principled BSDF with four image textures, on a plane that fills the
picture; compiling is the first picture less the next one. Mesa keeps compiled shaders from one run
to the next: clear its cache to see what compiling takes.
`python -m benchmarks.sparse_nodes [MODEL.exr]`
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import bpy

from addon.models.sparse.files import load_sparse
from addon.nodes.material import group_of, material_from_tables, set_lights
from addon.render.engines import set_engine, use_scripts
from addon.tables.sparse_tables import build_sparse_tables

from ._report import table
from ._sparse_sets import wool
from .nodes import lit_plane, megabytes, nodes_of, principled, seconds

QUALITIES = (4, 16, 64)
SUNS = (1, 4)
SIZE = (96, 72)
SAMPLES = 3


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.sparse_nodes", description=__doc__)
    parser.add_argument("model", type=Path, nargs="?", help="default: the sample")
    path = parser.parse_args().model
    model = load_sparse(path) if path else wool()
    plain = principled()
    rows = [
        ["N", "coefficients", "images", "suns", "nodes", "compiled in", "EEVEE", "Principled"]
        + ["Cycles, 1 sample"]
    ]
    for quality in QUALITIES:
        tables = build_sparse_tables(model.truncated(quality))
        material = material_from_tables(tables, "Model")
        for suns in SUNS:
            with lit_plane(SIZE, suns) as (scene, plane):
                set_lights(material, scene)
                plane.data.materials[0] = material
                first = seconds(scene, 1)
                ours, again = frame(scene)
                plane.data.materials[0] = plain
                seconds(scene, 1)
                theirs, _ = frame(scene)
                plane.data.materials[0] = material
                set_engine(scene, "cycles", 1)
                use_scripts(scene, material)
                cycles = min(cycles_seconds(scene) for _ in range(2))
            rows.append(
                [str(quality), str(group_end(material)), f"{megabytes(material):.0f} MB", str(suns)]
                + [str(nodes_of(group_of(material))), f"{first - again:.1f} s"]
                + [f"{1e3 * own:.0f} ms" for own in (ours, theirs, cycles)]
            )
        bpy.data.materials.remove(material)
    print(table(rows))


def group_end(material: bpy.types.Material) -> int:
    """Rounds of the loop."""
    node = next(n for n in group_of(material).nodes if n.bl_idname == "GeometryNodeRepeatInput")
    return int(node.inputs["Iterations"].default_value)


def frame(scene: bpy.types.Scene) -> tuple[float, float]:
    """Seconds of one sample of all pixels, and of a picture of one sample."""
    one = min(seconds(scene, 1) for _ in range(2))
    return (min(seconds(scene, SAMPLES) for _ in range(2)) - one) / (SAMPLES - 1), one


def cycles_seconds(scene: bpy.types.Scene) -> float:
    begun = time.perf_counter()
    bpy.ops.render.render(scene=scene.name)
    return time.perf_counter() - begun


if __name__ == "__main__":
    main()
