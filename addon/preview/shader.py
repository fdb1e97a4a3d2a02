"""Shaders printed for the shapes of tables: evaluate.glsl with its sizes as constants."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import gpu
import numpy as np
from numpy.typing import NDArray

from ..shader_files import shader_text
from ..tables.levels import regions
from .textures import can_filter, core_tiles

if TYPE_CHECKING:  # models need the compiled packages, and the engine registers without
    from ..tables.environment import EnvironmentTable
    from ..tables.tables import Tables

Constants = Mapping[str, str]
"""What evaluate.glsl is compiled with; equal for tables that differ only in their numbers."""

FULL_SCREEN = "void main() { gl_Position = vec4(position, 0.0, 1.0); }"
"""A vertex shader for three vertices `position` that cover the picture."""

_vec4 = "vec4({:.1f}, {:.1f}, {:.1f}, {:.1f})"


def constants(
    tables: Tables,
    world: EnvironmentTable | None = None,
    coordinates: NDArray[np.integer] | None = None,
) -> Constants:
    """The constants of one set of tables, without the set's name; with a world's light, and laid by
    a map of coordinates (H, W, 2)."""
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
    if world is not None:
        text["WORLD"] = str(world.grid)
        text["WORLD_CHANNELS"] = str(world.vectors.shape[1])
    if coordinates is not None:
        text["COORDINATES"] = "ivec2({1}, {0})".format(*coordinates.shape)
    return text


def samplers(numbers: Constants) -> tuple[str, ...]:
    """The textures that evaluate.glsl reads with these constants, without the set's name."""
    names = ["core", "view"]
    if "LIGHT" in numbers:
        names.append("light")
    names += [
        f"{mode}_index" for mode in ("light", "view") if int(numbers[f"C_{mode.upper()}"]) > 1
    ]
    names += [name for name in ("world", "coordinates") if name.upper() in numbers]
    return tuple(names)


def read_tables(
    info: gpu.types.GPUShaderCreateInfo, name: str, numbers: Constants, slot: int
) -> tuple[str, int]:
    """Constants and samplers of a set of tables for a shader: its printed source, and the next
    free slot. The push constant NAME_scale takes TableTextures.scale, NAME_world_scale its
    core_scale times that of the world's light."""
    for key, text in numbers.items():
        info.define(f"{name}_{key}", text)
    info.push_constant("FLOAT", f"{name}_scale")
    if "WORLD" in numbers:
        info.push_constant("FLOAT", f"{name}_world_scale")
    for texture in samplers(numbers):
        info.sampler(slot, "FLOAT_2D_ARRAY", f"{name}_{texture}")
        slot += 1
    return shader_text("evaluate.glsl").replace("TABLE", name), slot


def start_info() -> tuple[gpu.types.GPUShaderCreateInfo, str]:
    """An empty description of a shader that may read tables, and the text in front of theirs."""
    info = gpu.types.GPUShaderCreateInfo()
    if can_filter():
        info.define("NACRE_HARDWARE_FILTER", "1")
    return info, shader_text("parabolic.glsl") + shader_text("orientations.glsl")


def compile_info(info: gpu.types.GPUShaderCreateInfo) -> gpu.types.GPUShader:
    """The shader of a description."""
    return gpu.shader.create_from_info(info)


def let_go() -> None:
    """Bind a shader that stays. Blender skips binding a shader that lies where the last one bound
    did, even when that one was freed: nothing would be drawn with the new one."""
    gpu.shader.from_builtin("UNIFORM_COLOR").bind()
