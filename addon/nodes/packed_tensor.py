"""A tensor model's tables as images (packed_tables)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ..tables.levels import count_beside, levels_beside
from ..tables.tables import Tables
from .atlas import Atlas, cut_out, make_atlas

ATLASES = ("core", "view", "index", "light")


@dataclass(frozen=True)
class Shapes:
    """Sizes of the arrays of Tables; no light rows for occlusion."""

    clusters: tuple[int, int]  # of lights, of views
    light_rank: int
    light_owners: int
    light_mixtures: int
    light_quads: int
    view_owners: int
    view_mixtures: int
    view_quads: int
    channels: int
    height: int
    width: int
    size: int
    levels: int = 0  # halved copies beside the core

    @property
    def tile(self) -> tuple[int, int]:
        """Height and width of the core's tiles, levels included."""
        return self.height, self.width + (self.width // 2 if self.levels else 0)

    @property
    def reduced_once(self) -> bool:
        """Whether the core contracted with the view serves all lights."""
        return self.clusters[0] == 1

    @property
    def views_apart(self) -> bool:
        """Whether light rows differ from one of the view's clusters to the next."""
        return self.light_owners > 1


@dataclass(frozen=True)
class PackedTensor:
    """Four images at most, however many lights there are."""

    shapes: Shapes
    core: Atlas
    view: Atlas
    index: Atlas
    light: Atlas | None

    @property
    def atlases(self) -> dict[str, Atlas]:
        """By part, those that there are."""
        found = {part: getattr(self, part) for part in ATLASES}
        return {part: atlas for part, atlas in found.items() if atlas is not None}

    @classmethod
    def restored(cls, shapes: Mapping[str, Any], atlases: Mapping[str, Atlas]) -> PackedTensor:
        """What `atlases` and the fields of `shapes` were taken from."""
        clusters = tuple(shapes["clusters"])
        return cls(
            Shapes(**{**shapes, "clusters": clusters}),
            **{part: atlases.get(part) for part in ATLASES},
        )


def pack_tensor(name: str, tables: Tables) -> PackedTensor:
    """Make the images of a model. Raises NacreError when its tables do not fit a texture.

    Clusters of lights go across and clusters of views up in each of them, so that a cluster is one
    fraction of the width or of the height whatever it is looked up in; so are a light's mixtures.
    """
    size = tables.size
    blocks = {
        "core": levels_beside(
            tables.core.reshape(*tables.core.shape[:2], -1, *tables.core.shape[4:])
        ),
        "view": tables.view.reshape(len(tables.view), 1, -1, size, size, 4),
        "index": _indices(tables)[None, None],
    }
    if tables.light is not None:
        light = np.moveaxis(tables.light, 2, 0)
        blocks["light"] = light.reshape(*light.shape[:2], -1, size, size, 4)
    atlases: dict[str, Atlas] = {}
    try:
        for part, array in blocks.items():
            atlases[part] = make_atlas(f"{name} {part.title()}", array)
    except Exception:
        for atlas in atlases.values():
            bpy.data.images.remove(atlas.image)
        raise
    return PackedTensor(_shapes(tables), **{part: atlases.get(part) for part in ATLASES})


def unpack_tensor(packed: PackedTensor) -> Tables:
    """The tables that were packed."""
    shapes, size = packed.shapes, packed.shapes.size
    tiles = shapes.light_rank * shapes.view_quads
    core = cut_out(packed.core, tiles, *shapes.tile)[..., : shapes.width, :]
    light = None
    if packed.light is not None:
        light = cut_out(packed.light, shapes.channels * shapes.light_quads, size, size)
        light = light.reshape(*light.shape[:2], shapes.channels, shapes.light_quads, size, size, 4)
        light = np.moveaxis(light, 0, 2)
    view = cut_out(packed.view, shapes.view_mixtures * shapes.view_quads, size, size)
    first = -(-shapes.light_mixtures // 4)
    index = cut_out(packed.index, first - (-shapes.view_mixtures // 4), size, size)[0, 0]

    def clusters(tiles: np.ndarray, mixtures: int, count: int) -> np.ndarray:
        parts = np.moveaxis(tiles, -1, 1).reshape(-1, size, size)[:mixtures]
        return np.rint(parts * count).astype(np.uint32)

    return Tables(
        core=core.reshape(
            *shapes.clusters, shapes.light_rank, shapes.view_quads, shapes.height, shapes.width, 4
        ),
        light=light,
        view=view.reshape(
            shapes.view_owners, shapes.view_mixtures, shapes.view_quads, size, size, 4
        ),
        light_index=clusters(index[:first], shapes.light_mixtures, shapes.clusters[0]),
        view_index=clusters(index[first:], shapes.view_mixtures, shapes.clusters[1]),
    )


def _shapes(tables: Tables) -> Shapes:
    *clusters, rank, quads, height, width, _ = tables.core.shape
    owners, channels, mixtures, light_quads = (0, 1, 1, 0)
    if tables.light is not None:
        owners, channels, mixtures, light_quads = tables.light.shape[:4]
    return Shapes(
        clusters=(clusters[0], clusters[1]),
        light_rank=rank,
        light_owners=owners,
        light_mixtures=mixtures,
        light_quads=light_quads,
        view_owners=len(tables.view),
        view_mixtures=tables.view.shape[1],
        view_quads=quads,
        channels=channels,
        height=height,
        width=width,
        size=tables.size,
        levels=count_beside(height, width),
    )


def _indices(tables: Tables) -> np.ndarray:
    """Where the clusters of lights, then of views, begin: (tiles, N, N, 4), four to a texel."""
    tiles = []
    indices = tables.light_index, tables.view_index
    for index, count in zip(indices, tables.core.shape, strict=False):
        filled = np.pad(index, [(0, -len(index) % 4), (0, 0), (0, 0)]) / np.float32(count)
        tiles.append(filled.reshape(-1, 4, *index.shape[1:]).transpose(0, 2, 3, 1))
    return np.concatenate(tiles).astype(np.float32)
