"""Interpolation in image space, as a comparison: the values of the 3 x 3 measured lights and views
around a pair of directions are decoded whole, and mixed as colours (SparseBTF, Section 3.4)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import gpu
import numpy as np
from numpy.typing import NDArray

from addon.models.sparse.interpolation import weights
from addon.models.sparse.model import SparseBtf
from addon.preview.textures import laid_out, texture_array
from addon.shader_files import shader_text
from addon.tables.parabolic import texel_directions
from addon.tables.sparse_tables import SIZE, tables_at

from ._glsl import _COUNTED, _COUNTING, Screen

# A measured direction is a texel of the maps: (x, y, 1, as lights of it do not fade).
_ROWS = r"""
#define BTF_MEASURED 1
#define BTF_direction(direction) (direction).xy
#define BTF_light_quad(quad, place) texelFetch(BTF_light, ivec3(place, quad), 0)
#define BTF_view_quad(quad, place) texelFetch(BTF_view, ivec3(place, quad), 0)
#define BTF_view_images(point, place) point.images[0].xy = (place)
#define BTF_image(point, light, material) \
  texelFetch(IMAGE_normalised, \
             ivec3(image_number(light), image_number(point.images[0].xy), 0), \
             0)
int image_number(vec2 place)
{
  return int(place.y) * IMAGE_SIDE + int(place.x);
}
"""

_COMMON = r"""
struct IMAGE_Three { vec3 places[3]; vec3 weights; };

IMAGE_Three image_three(vec3 numbers, vec3 weights)
{
  IMAGE_Three three;
  for (int i = 0; i < 3; i++) {
    int number = int(numbers[i]);
    three.places[i] = vec3(float(number % IMAGE_SIDE), float(number / IMAGE_SIDE), 1.0);
  }
  three.weights = weights;
  return three;
}

#define IMAGE_THREE(map, direction) \
  image_three(texelFetch(map, ivec3(nacre_parabolic_texel(direction, IMAGE_MAP), 0), 0).xyz, \
              texelFetch(map, ivec3(nacre_parabolic_texel(direction, IMAGE_MAP), 1), 0).xyz)
"""

_WHOLE = """
struct IMAGE_Point { IMAGE_Three views; vec2 uv; };

IMAGE_Point IMAGE_prepare(vec3 view, vec2 uv, vec2 uv_dx, vec2 uv_dy)
{
  IMAGE_Point point;
  point.views = IMAGE_THREE(IMAGE_views, view);
  point.uv = uv;
  return point;
}

vec3 IMAGE_value(IMAGE_Point point, vec3 light)
{
  IMAGE_Three lights = IMAGE_THREE(IMAGE_lights, light);
  vec3 value = vec3(0.0);
  int pair = 0;
  do {
    int l = pair / 3;
    int v = pair % 3;
    BTF_Point decoded = BTF_prepare(point.views.places[v], point.uv, vec2(0.0), vec2(0.0));
    value += lights.weights[l] * point.views.weights[v] * BTF_value(decoded, lights.places[l]);
    pair++;
  } while (pair < 9);
  return value * clamp(light.z / BTF_LOWEST, 0.0, 1.0);
}
"""

# What the three views have in common for all lights, decoded once.
_SHARED = """
struct IMAGE_Point { vec3 weights; BTF_Point decoded[3]; };

IMAGE_Point IMAGE_prepare(vec3 view, vec2 uv, vec2 uv_dx, vec2 uv_dy)
{
  IMAGE_Point point;
  IMAGE_Three views = IMAGE_THREE(IMAGE_views, view);
  point.weights = views.weights;
  for (int v = 0; v < 3; v++) {
    point.decoded[v] = BTF_prepare(views.places[v], uv, vec2(0.0), vec2(0.0));
  }
  return point;
}

vec3 IMAGE_value(IMAGE_Point point, vec3 light)
{
  IMAGE_Three lights = IMAGE_THREE(IMAGE_lights, light);
  vec3 value = vec3(0.0);
  for (int v = 0; v < 3; v++) {
    for (int l = 0; l < 3; l++) {
      value += lights.weights[l] * point.weights[v] *
               BTF_value(point.decoded[v], lights.places[l]);
    }
  }
  return value * clamp(light.z / BTF_LOWEST, 0.0, 1.0);
}
"""

_SLOT = 10  # beyond those of the tables


class ImageSpace(Screen):
    """A picture of a model interpolated in image space; `shared` decodes the three views once for
    all lights."""

    def __init__(
        self,
        model: SparseBtf,
        size: tuple[int, int],
        suns: int,
        shared: bool = False,
        maps: int = SIZE,
    ) -> None:
        ensemble = model.ensemble
        self.side = int(np.ceil(np.sqrt(max(len(ensemble.light), len(ensemble.view)))))
        lights, views = (self._square(own) for own in (ensemble.light, ensemble.view))
        normalised = model.normalised
        # Means are read as they are, and are no part of what is coded.
        coded = replace(normalised, mean=np.zeros_like(normalised.mean))
        tables = tables_at(replace(model, normalised=coded), lights, views)
        super().__init__(laid_out(tables), size, suns)
        self.shared, self.maps = shared, maps
        images = np.concatenate([normalised.mean, normalised.deviation[..., None]], -1)
        images = images.swapaxes(0, 1)[None]
        self.samplers |= {
            "IMAGE_normalised": texture_array(images, "RGBA32F"),
            "IMAGE_lights": texture_array(_neighbours(ensemble.light, maps), "RGBA32F"),
            "IMAGE_views": texture_array(_neighbours(ensemble.view, maps), "RGBA32F"),
        }

    def _square(self, directions: NDArray[np.floating]) -> NDArray[np.floating]:
        missing = self.side**2 - len(directions)
        filled = np.concatenate([directions, np.repeat(directions[:1], missing, 0)])
        return filled.reshape(self.side, self.side, 3)

    def info(self) -> tuple[gpu.types.GPUShaderCreateInfo, str]:
        info, source = super().info()
        info.define("IMAGE_SIDE", str(self.side))
        info.define("IMAGE_MAP", str(self.maps))
        for number, name in enumerate(("normalised", "lights", "views")):
            info.sampler(_SLOT + number, "FLOAT_2D_ARRAY", f"IMAGE_{name}")
        return info, _ROWS + source + _COMMON + (_SHARED if self.shared else _WHOLE)

    def engine(self) -> Callable[[], None]:
        return self._draw(_SURFACE, self.view, self.lights)

    def counted(self) -> Callable[[], None]:
        return self._draw(_SURFACE + _COUNTED, self.view, self.lights, _COUNTING)


_SURFACE = shader_text("surface.glsl").replace("BTF_", "IMAGE_")


def _neighbours(measured: NDArray[np.floating], size: int) -> NDArray[np.float32]:
    """A parabolic map (2, N, N, 4) of the numbers of three directions, and of their weights."""
    share = weights(measured, texel_directions(size).reshape(-1, 3), "linear")
    numbers = np.argsort(-share, axis=1)[:, :3]
    found = np.stack([numbers, np.take_along_axis(share, numbers, 1)]).astype(np.float32)
    return np.pad(found, ((0, 0), (0, 0), (0, 1))).reshape(2, size, size, 4)
