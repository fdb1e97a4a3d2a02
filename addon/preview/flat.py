"""Tables evaluated on the graphics card over a flat patch: `decode` there, and what `verify`
compares."""

from __future__ import annotations

from collections.abc import Sequence

import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from numpy.typing import NDArray

from ..tables.any_tables import AnyTables
from .context import need_gpu
from .shader import FULL_SCREEN, compile_info, constants, four, let_go, read_tables, start_info
from .textures import laid_out, upload, upload_coordinates, upload_masks

_MAIN = """
void main()
{
  vec2 uv = nacre_place.xy + nacre_place.zw * gl_FragCoord.xy;
  BTF_Point point = BTF_prepare(nacre_view, uv, dFdx(uv), dFdy(uv));
#ifdef BTF_LIGHT
  nacre_colour = vec4(BTF_value(point, nacre_light), 1.0);
#else
  nacre_colour = vec4(vec3(BTF_occlusion(point)), 1.0);
#endif
}
"""


class FlatEvaluator:
    """One model's textures, or a blend's, and the shader that evaluates them for a light and a view
    at a time. `weights` of a blend may be changed from one picture to the next."""

    def __init__(
        self,
        *tables: AnyTables,
        coordinates: NDArray[np.integer] | None = None,
        weights: Sequence[float] = (),
        masks: NDArray[np.floating] | None = None,
    ) -> None:
        """`coordinates` (H, W, 2) is a map that lays the patch anew, `weights` are those of several
        sparse tables, and `masks` (n, y, x) factors to them.

        Raises NacreError where there is no GPU, tables do not fit its textures or cannot be
        blended.
        """
        need_gpu()
        held = laid_out(*tables)
        uploaded = upload(held)
        self.numbers, self.textures = uploaded.numbers, uploaded.textures
        self.lit, self.size = held.light is not None, (held.width, held.height)
        if coordinates is not None:
            self.textures = {**self.textures, **upload_coordinates(coordinates).textures}
        info, source = start_info()
        self.weights = tuple(weights)
        if masks is not None:
            self.textures = {**self.textures, **upload_masks(masks, held).textures}
        shape = constants(held, coordinates=coordinates, masked=masks is not None)
        text, _ = read_tables(info, "BTF", shape, 0)
        info.vertex_in(0, "VEC2", "position")
        info.push_constant("VEC4", "nacre_place")
        info.push_constant("VEC3", "nacre_light")
        info.push_constant("VEC3", "nacre_view")
        info.fragment_out(0, "VEC4", "nacre_colour")
        info.vertex_source(FULL_SCREEN)
        info.fragment_source(source + text + _MAIN)
        self.shader = compile_info(info)
        self.triangle = batch_for_shader(
            self.shader, "TRIS", {"position": ((-1, -1), (3, -1), (-1, 3))}
        )

    def picture(
        self,
        light: NDArray[np.floating],
        view: NDArray[np.floating],
        size: tuple[int, int] | None = None,
        patches: float = 1.0,
        offset: tuple[float, float] = (0.0, 0.0),
    ) -> NDArray[np.float32]:
        """Values (height, width, 3) for unit directions (3,), y upward; of occlusion three times
        the same. `size` is (width, height), the patch's own when not given; `patches` are seen
        along the width and height from `offset` on."""
        width, height = size or self.size
        screen = gpu.types.GPUOffScreen(width, height, format="RGBA32F")
        try:
            with screen.bind():
                self.draw(light, view, (*offset, patches / width, patches / height))
                pixels = gpu.state.active_framebuffer_get().read_color(
                    0, 0, width, height, 4, 0, "FLOAT"
                )
            return np.array(pixels, np.float32).reshape(height, width, 4)[..., :3]
        finally:
            screen.free()

    def draw(
        self,
        light: NDArray[np.floating],
        view: NDArray[np.floating],
        place: tuple[float, float, float, float],
    ) -> None:
        """Fill the bound frame buffer; uv of a pixel is place[:2] + place[2:] * its coordinates."""
        gpu.state.blend_set("NONE")
        gpu.state.depth_test_set("NONE")
        shader = self.shader
        shader.bind()
        for name, texture in self.textures.items():
            shader.uniform_sampler(f"BTF_{name}", texture)
        for name, number in self.numbers.items():
            shader.uniform_float(f"BTF_{name}", number)
        if len(self.weights) > 1:
            shader.uniform_float("BTF_weights", four(self.weights))
        if self.lit:
            shader.uniform_float("nacre_light", tuple(map(float, light)))
        shader.uniform_float("nacre_view", tuple(map(float, view)))
        shader.uniform_float("nacre_place", place)
        self.triangle.draw(shader)
        let_go()
