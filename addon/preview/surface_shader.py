"""The shader of a surface: positions to the screen, and a model's value under every light."""

from __future__ import annotations

import gpu

from ..nodes.light_group import KINDS
from ..shader_files import shader_text
from .lights import LIGHTS
from .shader import Constants, compile_info, read_tables, start_info

SHADOW_VIEWS = 64
"""Shadow maps of all lights together."""

_STRUCTS = """
struct NacreCamera { mat4 projection; vec4 camera; vec4 world; };
struct NacreMaterial { mat4 turn; vec4 base; vec4 repeat; };
struct NacreLight { vec4 position; vec4 axis; vec4 radiance; vec4 cone; };
struct NacreShadowView { mat4 projection; };
"""
_LIGHTS = f"struct NacreLights {{ vec4 count; NacreLight light[{LIGHTS}]; }};\n"


def surface_shader(
    btf: Constants | None, occlusion: Constants | None, shadow_size: int
) -> gpu.types.GPUShader:
    """A shader for tables of these constants; `shadow_size` texels along a shadow map or 0."""
    info, source = surface_info(btf, occlusion, shadow_size)
    info.fragment_out(0, "VEC4", "nacre_colour")
    info.fragment_source(source + shader_text("surface.glsl"))
    return compile_info(info)


def holes_shader(occlusion: Constants) -> gpu.types.GPUShader:
    """A shader that writes the depth of what is covered as a light sees it, for shadow maps; its
    camera is the light."""
    info, source = surface_info(None, occlusion, 0)
    info.define("NACRE_DEPTH", "1")
    info.fragment_source(source + shader_text("surface.glsl"))
    return compile_info(info)


def surface_info(
    btf: Constants | None, occlusion: Constants | None, shadow_size: int
) -> tuple[gpu.types.GPUShaderCreateInfo, str]:
    """A surface shader's description but for its fragments and their colour, and the text in front
    of their main.

    Push constants stay within the 128 bytes that every driver has.
    """
    info, source = start_info()
    info.typedef_source(_STRUCTS + _LIGHTS)
    info.uniform_buf(0, "NacreCamera", "nacre_camera")
    info.uniform_buf(1, "NacreLights", "nacre_lights")
    info.uniform_buf(3, "NacreMaterial", "nacre_material")
    for name, number in KINDS.items():
        info.define(f"NACRE_{name}", str(number))
    info.push_constant("MAT4", "nacre_object")
    info.push_constant("VEC4", "nacre_visibility")
    slot = 0
    for name, numbers in (("BTF", btf), ("OCCLUSION", occlusion)):
        if numbers is not None:
            text, slot = read_tables(info, name, numbers, slot)
            info.define(f"NACRE_{name}", "1")
            source += text
    if shadow_size:
        info.define("NACRE_SHADOWS", "1")
        info.define("NACRE_SHADOW_SIZE", str(shadow_size))
        info.uniform_buf(2, "NacreShadowView", f"nacre_shadow_views[{SHADOW_VIEWS}]")
        info.sampler(slot, "DEPTH_2D_ARRAY", "nacre_shadow_maps")
        source += shader_text("shadows.glsl")
    _vertices(info)
    between = gpu.types.GPUStageInterfaceInfo("nacre_surface")
    between.smooth("VEC3", "nacre_position")
    between.smooth("VEC3", "nacre_normal")
    between.smooth("VEC4", "nacre_tangent")
    between.smooth("VEC2", "nacre_uv")
    info.vertex_out(between)
    info.vertex_source(shader_text("surface_vertex.glsl"))
    return info, source


def depth_shader() -> gpu.types.GPUShader:
    """A shader that only writes depth, for shadow maps."""
    info = gpu.types.GPUShaderCreateInfo()
    info.vertex_in(0, "VEC3", "position")
    info.push_constant("MAT4", "nacre_projection")
    info.vertex_source("void main() { gl_Position = nacre_projection * vec4(position, 1.0); }")
    info.fragment_source("void main() {}")
    return compile_info(info)


def _vertices(info: gpu.types.GPUShaderCreateInfo) -> None:
    for slot, (name, kind) in enumerate(
        (("position", "VEC3"), ("normal", "VEC3"), ("tangent", "VEC4"), ("uv", "VEC2"))
    ):
        info.vertex_in(slot, kind, name)
