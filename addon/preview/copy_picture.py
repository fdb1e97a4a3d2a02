"""A finished picture copied into the viewport, which turns linear colours into the display's."""

from __future__ import annotations

import gpu
from gpu_extras.batch import batch_for_shader

from .shader import FULL_SCREEN, compile_info, let_go


def copy_picture(picture: gpu.types.GPUTexture, shader: gpu.types.GPUShader) -> None:
    """Blend a picture with premultiplied alpha into the bound frame buffer, pixel for pixel."""
    triangle = batch_for_shader(shader, "TRIS", {"position": ((-1, -1), (3, -1), (-1, 3))})
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("ALPHA_PREMULT")
    shader.bind()
    shader.uniform_sampler("nacre_picture", picture)
    triangle.draw(shader)
    gpu.state.blend_set("NONE")
    let_go()


def copy_shader() -> gpu.types.GPUShader:
    """The shader that `copy_picture` takes."""
    info = gpu.types.GPUShaderCreateInfo()
    info.vertex_in(0, "VEC2", "position")
    info.sampler(0, "FLOAT_2D", "nacre_picture")
    info.fragment_out(0, "VEC4", "nacre_colour")
    info.vertex_source(FULL_SCREEN)
    info.fragment_source(
        "void main() { nacre_colour = texelFetch(nacre_picture, ivec2(gl_FragCoord.xy), 0); }"
    )
    return compile_info(info)
