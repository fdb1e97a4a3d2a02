"""The engine's surface shader on a picture that it fills, its fetches summed, and counted."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from math import pi

import gpu
import numpy as np
from mathutils import Matrix, Vector

from addon.datasets.directions import spherical_to_unit
from addon.preview.lights import Light, light_rows
from addon.preview.shader import compile_info, constants, let_go
from addon.preview.surface_shader import surface_info
from addon.preview.textures import upload
from addon.shader_files import shader_text
from addon.tables.parabolic import texel_of
from addon.tables.sparse_layout import SparseLayout
from addon.tables.tables import Tables

MAGNIFIED = 8  # pixels to a texel: the finest level alone, one tap

_COUNTING = """
int nacre_fetches = 0;
vec4 nacre_count(vec4 fetched)
{
  nacre_fetches++;
  return fetched;
}
#define texelFetch(texture, place, level) nacre_count(texelFetch(texture, place, level))
#define textureLod(texture, place, level) nacre_count(textureLod(texture, place, level))
#define main nacre_main
"""

_COUNTED = """
#undef main
void main()
{
  nacre_main();
  nacre_colour = vec4(float(nacre_fetches));
}
"""

_SUM = """
/* The fetches of BTF_prepare and BTF_value and nothing else; the texels are given. */
void main()
{
  vec4 sum = vec4(0.0);
  const vec4 regions[BTF_LEVELS] = BTF_REGIONS;
  vec2 place = regions[0].xy + fract(nacre_uv) * regions[0].zw;
  ivec2 view = ivec2(nacre_camera.camera.xy);
  int count = int(nacre_lights.count.x);
  int own[BTF_K_VIEW];
  BTF_view_clusters(view, own);
#if BTF_C_LIGHT == 1
  for (int k = 0; k < BTF_K_VIEW; k++) {
    for (int q = 0; q < BTF_VIEW_QUADS; q++) {
      sum += BTF_view_quad(0, k, q, view);
    }
    for (int block = 0; block < BTF_BLOCKS; block++) {
      sum += BTF_core_quad(own[k] * BTF_BLOCKS + block, place);
    }
  }
#endif
  int i = 0;
  do {
    ivec2 texel = ivec2(nacre_lights.light[i].cone.xy);
#if BTF_C_LIGHT == 1
    for (int channel = 0; channel < BTF_CHANNELS; channel++) {
      for (int quad = 0; quad < BTF_LIGHT_QUADS; quad++) {
        sum += BTF_light_quad(own[0], channel, 0, quad, texel);
      }
    }
#else
    int found[BTF_K_LIGHT];
    BTF_light_clusters(texel, found);
    for (int kl = 0; kl < BTF_K_LIGHT; kl++) {
      for (int kv = 0; kv < BTF_K_VIEW; kv++) {
        for (int q = 0; q < BTF_VIEW_QUADS; q++) {
          sum += BTF_view_quad(found[kl], kv, q, view);
        }
        int first = (found[kl] * BTF_C_VIEW + own[kv]) * BTF_BLOCKS;
        for (int block = 0; block < BTF_BLOCKS; block++) {
          sum += BTF_core_quad(first + block, place);
        }
        for (int channel = 0; channel < BTF_CHANNELS; channel++) {
          for (int quad = 0; quad < BTF_LIGHT_QUADS; quad++) {
            sum += BTF_light_quad(own[kv], channel, kl, quad, texel);
          }
        }
      }
    }
#endif
    i++;
  } while (i < count);
  nacre_colour = sum;
}
"""


class Screen:
    """A plane that fills a picture (width, height), under suns without shadows."""

    def __init__(self, tables: Tables | SparseLayout, size: tuple[int, int], suns: int) -> None:
        self.tables, self.size = tables, size
        self.textures = upload(tables)
        self.samplers = {f"BTF_{name}": own for name, own in self.textures.textures.items()}
        self.target = gpu.types.GPUOffScreen(*size, format="RGBA32F")
        self.view = np.array(Vector((0.25, -0.2, 1.0)).normalized())
        axes = [Vector(spherical_to_unit([20 + 5 * n], [47 * n])[0]) for n in range(suns)]
        nowhere = Vector().freeze()
        self.lights = light_rows([Light("SUN", nowhere, a.freeze(), (pi,) * 3) for a in axes])
        self.axes = np.array(axes)

    def info(self) -> tuple[gpu.types.GPUShaderCreateInfo, str]:
        """The shader's description, and the text in front of its main."""
        return surface_info(constants(self.tables), None, 0)

    def engine(self) -> Callable[[], None]:
        """Draw what the engine draws."""
        return self._draw(shader_text("surface.glsl"), self.view, self.lights)

    def counted(self) -> Callable[[], None]:
        """Draw the number of its fetches."""
        source = shader_text("surface.glsl") + _COUNTED
        return self._draw(source, self.view, self.lights, _COUNTING)

    def summed(self) -> Callable[[], None]:
        """Draw the sum of its fetches; of tensor models."""
        lights = self.lights.copy()
        texels = texel_of(self.axes, self.tables.size)
        lights[1:].reshape(-1, 4, 4)[: len(texels), 3, :2] = texels
        return self._draw(_SUM, np.append(texel_of(self.view, self.tables.size), 0), lights)

    def pixels(self, draw: Callable[[], None]) -> np.ndarray:
        """A picture (height, width, 4)."""
        width, height = self.size
        with self.target.bind():
            draw()
            screen = gpu.state.active_framebuffer_get()
            return np.array(screen.read_color(0, 0, width, height, 4, 0, "FLOAT"))

    def seconds(self, draw: Callable[[], None]) -> float:
        """A frame, to the last pixel: reading one waits for all."""
        with self.target.bind():
            screen = gpu.state.active_framebuffer_get()
            screen.read_color(0, 0, 1, 1, 4, 0, "FLOAT")
            started = time.perf_counter()
            draw()
            screen.read_color(0, 0, 1, 1, 4, 0, "FLOAT")
            return time.perf_counter() - started

    def _draw(
        self, main: str, viewer: np.ndarray, lights: np.ndarray, before: str = ""
    ) -> Callable[[], None]:
        info, source = self.info()
        info.fragment_out(0, "VEC4", "nacre_colour")
        info.fragment_source(before + source + main)
        shader = compile_info(info)
        blocks = {
            "nacre_camera": np.concatenate([np.eye(4).ravel(), viewer, np.zeros(5)]),
            "nacre_lights": lights,
            "nacre_material": np.concatenate([np.eye(4).ravel(), np.ones(8)]),
        }
        buffers = {name: _uniforms(data) for name, data in blocks.items()}
        triangle = self._triangle(shader)

        def draw() -> None:
            gpu.state.blend_set("NONE")
            gpu.state.depth_test_set("NONE")
            shader.bind()
            for name, texture in self.samplers.items():
                shader.uniform_sampler(name, texture)
            with suppress(ValueError):  # not used by this main
                for name, number in self.textures.numbers.items():
                    shader.uniform_float(f"BTF_{name}", number)
            for name, buffer in buffers.items():
                with suppress(ValueError):
                    shader.uniform_block(name, buffer)
            shader.uniform_float("nacre_object", Matrix())
            triangle.draw(shader)
            let_go()

        return draw

    def _triangle(self, shader: gpu.types.GPUShader) -> gpu.types.GPUBatch:
        texels = MAGNIFIED * self.tables.height
        u, v = 2 * self.size[0] / texels, 2 * self.size[1] / texels
        corners = {
            "position": [(-1, -1, 0), (3, -1, 0), (-1, 3, 0)],
            "normal": [(0, 0, 1)] * 3,
            "tangent": [(1, 0, 0, 1)] * 3,
            "uv": [(0, 0), (u, 0), (0, v)],
        }
        layout = gpu.types.GPUVertFormat()
        for name, values in corners.items():
            layout.attr_add(id=name, comp_type="F32", len=len(values[0]), fetch_mode="FLOAT")
        vertices = gpu.types.GPUVertBuf(layout, 3)
        for name, values in corners.items():
            vertices.attr_fill(name, np.array(values, np.float32))
        return gpu.types.GPUBatch(type="TRIS", buf=vertices)


def _uniforms(data: np.ndarray) -> gpu.types.GPUUniformBuf:
    data = np.ascontiguousarray(data, np.float32).ravel()
    return gpu.types.GPUUniformBuf(gpu.types.Buffer("FLOAT", data.size, data))
