"""The evaluation of a sparse model's tables in Cycles: a script node (shaders/sparse.osl).

Cycles unrolls loops of shader nodes and runs out of its stack. Open Shading Language has loops, but
Blender gives it no images: so they are written to files, under names that say what is in them, in
the folder that Blender removes when it ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np
import OpenEXR

from ..errors import NacreError
from ..osl import compile_osl, has_osl
from .graph import Graph, Wire
from .packed_sparse import ATLASES, PackedSparse
from .sparse_evaluation import SparseAverage

SHADER = "sparse.osl"
LIGHTS = 4
"""Of one script node; as in the shader."""

_FILES = ("coefficients", "texels", "light_rows", "view_rows")
_NODE = "Nacre Sparse"
_STAMP = "nacre_stamp"


class SparseScript:
    """What all lights share at a texel seen from a direction, and then any number of lights; as
    SparseEvaluation has it."""

    def __init__(
        self, g: Graph, packed: PackedSparse, texel: tuple[Wire, Wire], view: Wire
    ) -> None:
        self.packed, self.texel, self.view = packed, texel, view
        if has_osl():
            self.files = write_files(packed)
            self.code = compile_osl(SHADER, "sparse_shapes.h", _header(packed))

    def log_values(self, g: Graph, lights: Sequence[Wire]) -> list[Wire]:
        """Y, U, V of the logarithm of the colour under each light, a unit vector in the tangent
        frame; of the average colour where Blender has no Open Shading Language."""
        if not has_osl():
            return SparseAverage(g, self.packed, self.texel, self.view).log_values(g, lights)
        values: list[Wire] = []
        for first in range(0, len(lights), LIGHTS):
            values += self._script(g, lights[first : first + LIGHTS])
        return values

    def _script(self, g: Graph, lights: Sequence[Wire]) -> list[Wire]:
        node = g.node("ShaderNodeScript")
        node.name = node.label = _NODE
        node[_STAMP] = self.packed.shapes.stamp
        node.bytecode, node.bytecode_hash = self.code
        # Blender's own operator would make these: it asks oslquery, which not every build has.
        for name in _FILES:
            node.inputs.new("NodeSocketString", name)
        for name in ("texel", "view"):
            node.inputs.new("NodeSocketVector", name)
        node.inputs.new("NodeSocketInt", "lights").default_value = len(lights)
        g.connect(g.combine(*self.texel), node.inputs["texel"])
        g.connect(self.view, node.inputs["view"])
        for number, light in enumerate(lights, 1):
            g.connect(light, node.inputs.new("NodeSocketVector", f"light_{number}"))
            node.outputs.new("NodeSocketVector", f"value_{number}")
        _show_files(node, self.files)
        average = self.packed.shapes.average
        values = []
        for number in range(1, len(lights) + 1):
            # Where scripts do not run, what they are linked to keeps its own value.
            kept = g.node("ShaderNodeVectorMath", average, operation="ADD")
            g.connect(g.wire(node, f"value_{number}"), kept.inputs[0])
            values.append(g.wire(kept))
        return values


def follow_files(tree: bpy.types.ShaderNodeTree, models: Sequence[PackedSparse]) -> None:
    """Write what a group's scripts read where it is missing, as in a file that was just opened."""
    for packed in models:
        scripts = [node for node in tree.nodes if node.get(_STAMP) == packed.shapes.stamp]
        if scripts:
            files = write_files(packed)
            for node in scripts:
                _show_files(node, files)


def write_files(packed: PackedSparse) -> dict[str, Path]:
    """Files with the images of a model, by their name in the shader."""
    found = {}
    for name, part in zip(_FILES, ATLASES, strict=True):
        image = packed.atlases[part].image
        path = Path(bpy.app.tempdir) / f"nacre-{packed.shapes.stamp}-{part}.exr"
        if not path.is_file():
            _write(path, image)
        found[name] = path
    return found


def _write(path: Path, image: bpy.types.Image) -> None:
    width, height = image.size
    pixels = np.empty(height * width * 4, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(height, width, 4)
    channels = {name: np.ascontiguousarray(pixels[..., i]) for i, name in enumerate("RGBA")}
    header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
    temporary = path.with_suffix(".part.exr")
    try:
        OpenEXR.File(header, channels).write(str(temporary))
        temporary.replace(path)
    except (OSError, RuntimeError) as error:
        temporary.unlink(missing_ok=True)
        raise NacreError(f"{path}: could not be written, and Cycles reads it ({error})") from error


def _show_files(node: bpy.types.Node, files: dict[str, Path]) -> None:
    for name, path in files.items():
        if node.inputs[name].default_value != str(path):
            node.inputs[name].default_value = str(path)


def _header(packed: PackedSparse) -> str:
    shapes = packed.shapes
    values = {
        "COUNT": shapes.ends[-1],
        "PATCHES_UP": shapes.patches[0],
        "PATCHES_ACROSS": shapes.patches[1],
        "TALL": shapes.patch[0],
        "WIDE": shapes.patch[1],
        "TEXEL_ROWS": packed.texels.image.size[1],
        "LIGHT_ROWS": sum(shapes.light),
        "VIEW_ROWS": sum(shapes.view),
        "SIZE": shapes.size,
    }
    for number, end in enumerate(np.cumsum(shapes.light)):
        values[f"LIGHT_END_{number}"] = int(end)
    for name, atlas in (("LIGHT", packed.light), ("VIEW", packed.view)):
        values |= {f"{name}_ACROSS": atlas.columns, f"{name}_UP": atlas.rows}
    return "".join(f"#define {name} {value}\n" for name, value in values.items())
