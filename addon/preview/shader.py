"""Shaders printed for the shapes of tables: evaluate.glsl or sparse.glsl with its sizes as
constants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import TYPE_CHECKING

import gpu
import numpy as np
from numpy.typing import NDArray

from ..shader_files import shader_text
from ..tables.levels import regions
from ..tables.sparse_layout import SparseLayout
from .textures import can_filter, core_tiles

if TYPE_CHECKING:  # models need the compiled packages, and the engine registers without
    from ..tables.environment import EnvironmentTable
    from ..tables.tables import Tables

Constants = Mapping[str, str]
"""What a shader of tables is compiled with; equal for tables that differ only in their numbers."""

FULL_SCREEN = "void main() { gl_Position = vec4(position, 0.0, 1.0); }"
"""A vertex shader for three vertices `position` that cover the picture."""

_vec4 = "vec4({:.1f}, {:.1f}, {:.1f}, {:.1f})"


def constants(
    tables: Tables | SparseLayout,
    world: EnvironmentTable | None = None,
    coordinates: NDArray[np.integer] | None = None,
    masked: bool = False,
) -> Constants:
    """The constants of one set of tables, without the set's name; with a world's light, laid by a
    map of coordinates (H, W, 2), or blended by masks. Sparse ones have no world's light."""
    text = _sparse(tables) if isinstance(tables, SparseLayout) else _tensor(tables)
    if world is not None:
        text["WORLD"] = str(world.grid)
        text["WORLD_CHANNELS"] = str(world.vectors.shape[1])
    if coordinates is not None:
        text["COORDINATES"] = "ivec2({1}, {0})".format(*coordinates.shape)
    if masked:
        text["MASKS"] = "1"
    return text


def _tensor(tables: Tables) -> dict[str, str]:
    clusters_light, clusters_view, rank, view_quads, height, width, _ = tables.core.shape
    layout = regions(height, width)
    tiles = core_tiles(clusters_light * clusters_view * rank * view_quads)
    across = layout.shape[1] * tiles
    numbers = {
        "C_LIGHT": clusters_light,
        "C_VIEW": clusters_view,
        "K_LIGHT": len(tables.light_index),
        "K_VIEW": len(tables.view_index),
        "R_LIGHT": rank,
        "LIGHT_QUADS": -(-rank // 4),
        "VIEW_QUADS": view_quads,
        "VIEW_OWNERS": len(tables.view),
        "CHANNELS": tables.channels,
        "MAP": tables.size,
        "CORE_TILES": tiles,
        "CORE_PITCH": layout.shape[1],
        "LEVELS": len(layout.places),
    }
    text = {name: str(number) for name, number in numbers.items()}
    text["CORE_STEP"] = f"vec2({1.0 / across:.12g}, {1.0 / layout.shape[0]:.12g})"
    places = ", ".join(_vec4.format(*place) for place in layout.places)
    text["REGIONS"] = f"vec4[{len(layout.places)}]({places})"
    if tables.light is not None:
        text["LIGHT"] = "1"
        text["LIGHT_OWNERS"] = str(len(tables.light))
    else:
        text["LIGHT_OWNERS"] = "1"
    return text


def _sparse(layout: SparseLayout) -> dict[str, str]:
    from ..models.domain import TO_RGB

    ends = [0, *accumulate(quads for images in layout.images for quads in images)]
    numbers = {
        "TEXEL_QUADS": layout.longest[0],
        "LIGHT_QUADS": layout.longest[1],
        "VIEW_QUADS": layout.longest[2],
        "MATERIALS": len(layout.images),
        "IMAGES": ends[-1],
        "LIGHT_IMAGES": len(layout.light) - ends[-1],
        "VIEW_IMAGES": len(layout.view) - ends[-1],
        "LIGHT_TILES": core_tiles(len(layout.light)),
        "VIEW_TILES": core_tiles(len(layout.view)),
        "MAP": layout.light.shape[1],
        "LEVELS": len(layout.levels),
        "PATCH_LEVELS": len(layout.patches),
    }
    text = {name: str(number) for name, number in numbers.items()}
    text["SIZES"], text["PATCHES"] = _places(layout.levels), _places(layout.patches)
    images = [f"ivec3{tuple(ends[i : i + 3])}" for i in range(0, len(ends) - 2, 2)]
    text["IMAGES_OF"] = f"ivec3[{len(images)}]({', '.join(images)})"
    text["SIZE"] = f"vec2({layout.width:.1f}, {layout.height:.1f})"
    text["TO_RGB"] = "mat3({})".format(", ".join(f"{part:.9g}" for part in TO_RGB.T.ravel()))
    text["OFFSET"] = f"{layout.offset:.9g}"
    text["LOWEST"] = f"{max(layout.lowest, 1e-6):.9g}"
    text["SPARSE"] = text["LIGHT"] = "1"
    return text


def _places(sizes: Sequence[tuple[int, int]]) -> str:
    """Width, height and first number of levels (height, width) that lie one after the other."""
    firsts = accumulate((height * width for height, width in sizes), initial=0)
    texts = [
        f"ivec3({width}, {height}, {first})"
        for (height, width), first in zip(sizes, firsts, strict=False)
    ]
    return f"ivec3[{len(texts)}]({', '.join(texts)})"


def samplers(numbers: Constants) -> tuple[str, ...]:
    """The textures that are read with these constants, without the set's name."""
    if "SPARSE" in numbers:
        names = ["coefficients", "lists", "texels", "light", "view"]
    else:
        names = ["core", "view", *(["light"] if "LIGHT" in numbers else [])]
        names += [
            f"{mode}_index" for mode in ("light", "view") if int(numbers[f"C_{mode.upper()}"]) > 1
        ]
    names += [name for name in ("world", "coordinates", "masks") if name.upper() in numbers]
    return tuple(names)


def read_tables(
    info: gpu.types.GPUShaderCreateInfo, name: str, numbers: Constants, slot: int
) -> tuple[str, int]:
    """Constants and samplers of a set of tables for a shader: its printed source, and the next
    free slot. The push constants are TableTextures.numbers, and NAME_world_scale, its core_scale
    times that of the world's light, or NAME_weights of a blend."""
    for key, text in numbers.items():
        info.define(f"{name}_{key}", text)
    if "SPARSE" not in numbers:
        info.push_constant("FLOAT", f"{name}_scale")
    elif int(numbers["MATERIALS"]) > 1:
        info.push_constant("VEC4", f"{name}_weights")
    if "WORLD" in numbers:
        info.push_constant("FLOAT", f"{name}_world_scale")
    for texture in samplers(numbers):
        info.sampler(slot, "FLOAT_2D_ARRAY", f"{name}_{texture}")
        slot += 1
    source = "sparse.glsl" if "SPARSE" in numbers else "evaluate.glsl"
    return shader_text(source).replace("TABLE", name), slot


def start_info() -> tuple[gpu.types.GPUShaderCreateInfo, str]:
    """An empty description of a shader that may read tables, and the text in front of theirs."""
    info = gpu.types.GPUShaderCreateInfo()
    if can_filter():
        info.define("NACRE_HARDWARE_FILTER", "1")
    texts = ("parabolic.glsl", "orientations.glsl", "sparse_common.glsl")
    return info, "".join(map(shader_text, texts))


def four(weights: Sequence[float]) -> tuple[float, ...]:
    """Weights of a blend as NAME_weights takes them."""
    return (*map(float, weights), *[0.0] * (4 - len(weights)))


def compile_info(info: gpu.types.GPUShaderCreateInfo) -> gpu.types.GPUShader:
    """The shader of a description."""
    return gpu.shader.create_from_info(info)


def let_go() -> None:
    """Bind a shader that stays. Blender skips binding a shader that lies where the last one bound
    did, even when that one was freed: nothing would be drawn with the new one."""
    gpu.shader.from_builtin("UNIFORM_COLOR").bind()
