"""Tables on the graphics card: texture arrays whose layers are blocks of the core and map quads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import gpu
import numpy as np
from numpy.typing import NDArray

from ..errors import NacreError
from ..tables.levels import layers_of_levels
from ..tables.sparse_layout import SparseLayout, masks_of_levels, sparse_layout

if TYPE_CHECKING:  # models need the compiled packages, and the engine registers without
    from ..tables.any_tables import AnyTables
    from ..tables.environment import EnvironmentTable
    from ..tables.tables import Tables

LARGEST = 16384
"""Texels along a texture that every driver takes."""

LAYERS = 2048
"""Layers of a texture array that every driver takes."""

TEXEL_BYTES = 8  # RGBA, half floats


@dataclass(frozen=True)
class Uploaded:
    """Textures and numbers by the names that evaluate.glsl gives them, without the set's; `bytes`
    on the card."""

    textures: dict[str, gpu.types.GPUTexture]
    bytes: int
    numbers: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class TableTextures(Uploaded):
    """Those of one set of tables: half floats scaled to a peak of 1 each.

    The number `scale` takes values back, and `core_scale` the core contracted with the view.
    """

    core_scale: float = 1.0


def can_filter() -> bool:
    """Whether textures made by Python filter and repeat in hardware; from 5.2."""
    return hasattr(gpu.types.GPUTexture, "filter_mode")


def filter_in_hardware(texture: gpu.types.GPUTexture) -> None:
    """Have a texture filtered where it can be."""
    if can_filter():
        texture.filter_mode(True)


def core_tiles(blocks: int) -> int:
    """Core blocks side by side in one layer, where there are more of them than layers."""
    return -(-blocks // LAYERS)


def laid_out(*tables: AnyTables) -> Tables | SparseLayout:
    """Tables as `upload` takes them, or those of a blend; made once and not for each picture.

    Raises NacreError for tables that cannot be blended.
    """
    from ..tables.sparse_tables import SparseTables

    sparse = [one for one in tables if isinstance(one, SparseTables)]
    if len(sparse) == len(tables):
        return sparse_layout(*sparse)
    if len(tables) > 1:
        raise NacreError("only sparse models can be blended")
    return tables[0]


def upload(tables: Tables | SparseLayout) -> TableTextures:
    """Tables as half floats on the card. Raises NacreError when they do not fit textures."""
    if isinstance(tables, SparseLayout):
        return _upload_sparse(tables)
    arrays = {"core": tiled(layers_of_levels(tables.core)), "view": _layers(tables.view)}
    if tables.light is not None:
        arrays["light"] = _layers(tables.light)
    peaks = {name: float(np.abs(array).max()) or 1.0 for name, array in arrays.items()}
    for name, peak in peaks.items():
        arrays[name] = arrays[name] / np.float32(peak)
    core_scale = peaks["core"] * peaks["view"]
    for name, index, clusters in (
        ("light_index", tables.light_index, tables.core.shape[0]),
        ("view_index", tables.view_index, tables.core.shape[1]),
    ):
        if clusters > 1:
            arrays[name] = _index_quads(index)
    textures = {name: texture_array(array) for name, array in arrays.items()}
    filter_in_hardware(textures["core"])
    size = sum(array.size // 4 * TEXEL_BYTES for array in arrays.values())
    numbers = {"scale": core_scale * peaks.get("light", 1.0)}
    return TableTextures(textures, size, numbers, core_scale)


def _upload_sparse(layout: SparseLayout) -> TableTextures:
    arrays = {name: getattr(layout, name) for name in ("coefficients", "texels")}
    arrays |= {name: tiled(getattr(layout, name)) for name in ("light", "view")}
    textures = {name: texture_array(array) for name, array in arrays.items()}
    for name in ("light", "view"):
        filter_in_hardware(textures[name])
    # Half floats count to 2048.
    textures["lists"] = texture_array(layout.lists, "RGBA32F")
    size = sum(array.size // 4 * TEXEL_BYTES for array in arrays.values()) + layout.lists.nbytes
    return TableTextures(textures, size)


def upload_world(table: EnvironmentTable) -> Uploaded:
    """A world's light, as it is: a layer for each cluster of lights, owner, channel and quad, 8 G
    rows and G * G columns of orientations.

    Raises NacreError when it does not fit a texture.
    """
    grid = table.grid
    layers = np.moveaxis(table.vectors, 2, 0).reshape(-1, 8 * grid, grid * grid, 4)
    return Uploaded({"world": texture_array(layers)}, table.vectors.nbytes)


def upload_coordinates(coordinates: NDArray[np.integer]) -> Uploaded:
    """A map of coordinates (H, W, 2), row and column of a patch's texel, as (column, row, 0, 0)."""
    pixels = np.zeros((1, *coordinates.shape[:2], 4), np.float32)
    pixels[0, ..., :2] = coordinates[..., ::-1]
    return Uploaded({"coordinates": texture_array(pixels, "RGBA32F")}, pixels.nbytes)


def upload_masks(masks: NDArray[np.floating], layout: SparseLayout) -> Uploaded:
    """Weights (n, y, x) of a blend's materials. Raises NacreError for those of another size."""
    pixels = masks_of_levels(masks, layout)
    return Uploaded({"masks": texture_array(pixels)}, pixels.size // 4 * TEXEL_BYTES)


def texture_array(array: NDArray[np.float32], format: str = "RGBA16F") -> gpu.types.GPUTexture:
    """A texture array from (layers, height, width, 4). Raises NacreError beyond the limits."""
    layers, height, width, _ = array.shape
    if layers > LAYERS or max(height, width) > LARGEST:
        raise NacreError(
            f"the tables need a texture of {width} x {height} with {layers} layers, and graphics "
            f"cards take {LARGEST} x {LARGEST} with {LAYERS}: compress with lower ranks or fewer "
            "clusters, or a lower quality"
        )
    data = np.ascontiguousarray(array, np.float32).reshape(-1)
    buffer = gpu.types.Buffer("FLOAT", data.size, data)
    return gpu.types.GPUTexture((width, height), layers=layers, format=format, data=buffer)


def _layers(maps: NDArray[np.float32]) -> NDArray[np.float32]:
    return maps.reshape(-1, *maps.shape[-3:])


def tiled(blocks: NDArray[np.float32]) -> NDArray[np.float32]:
    """Blocks (n, height, width, 4) as layers of `core_tiles` blocks side by side."""
    tiles = core_tiles(len(blocks))
    if tiles == 1:
        return blocks
    count, height, width, _ = blocks.shape
    filled = np.zeros((-(-count // tiles) * tiles, height, width, 4), np.float32)
    filled[:count] = blocks
    filled = filled.reshape(-1, tiles, height, width, 4).swapaxes(1, 2)
    return filled.reshape(-1, height, tiles * width, 4)


def _index_quads(index: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Clusters (K, N, N) in quads (K / 4, N, N, 4); half floats hold them exactly, as a core has
    at most 2048 clusters."""
    filled = np.pad(index, ((0, -len(index) % 4), (0, 0), (0, 0)))
    return np.moveaxis(filled.reshape(-1, 4, *index.shape[1:]), 1, -1).astype(np.float32)
