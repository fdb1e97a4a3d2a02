"""What a material shows in the engine: a model's tables, or a plain colour."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from ..errors import NacreError
from .textures import laid_out

if TYPE_CHECKING:  # models need the compiled packages, and the engine registers without
    from ..tables.environment import EnvironmentTable
    from ..tables.sparse_layout import SparseLayout
    from ..tables.tables import Tables

Read = tuple["Tables | SparseLayout | None", str]
"""Tables, or why there are none."""

KEPT = 8
"""Models whose tables are kept for another picture."""


@dataclass(frozen=True)
class WorldLight:
    """A world's light on a model, and the name of the world whose node `mapping` turns it."""

    table: EnvironmentTable
    world: str = ""
    mapping: str = ""


@dataclass(frozen=True)
class Appearance:
    """Tables of a BTF or of occlusion, or neither; `message` says why a model could not be read or
    mixed, `note` what of it is shown otherwise.

    `coordinates` (H, W, 2) is the map that lays the patch anew, `lights` names the collection that
    lights it; "" for the scene. Visibility is Eq. 26's threshold and weight, `repeat` the patches
    along u and v in one UV unit. A blend has the `weights` of its materials, and may have `masks`
    (n, y, x) that they are multiplied with.
    """

    btf: Tables | SparseLayout | None = None
    occlusion: Tables | None = None
    world: WorldLight | None = None
    coordinates: NDArray[np.integer] | None = None
    lights: str = ""
    visibility: tuple[float, float] = (0.5, 1.0)
    repeat: tuple[float, float] = (1.0, 1.0)
    weights: tuple[float, ...] = ()
    masks: NDArray[np.floating] | None = None
    base: tuple[float, float, float] = (0.8, 0.8, 0.8)
    message: str = ""
    note: str = ""


def final_appearance_of(material: bpy.types.Material | None) -> Appearance:
    """A material's appearance in a final render, which may show another model."""
    return appearance_of(material, final=True)


def appearance_of(
    material: bpy.types.Material | None,
    final: bool = False,
    read: Callable[[str], Read] | None = None,
) -> Appearance:
    """A material's appearance; never raises for a model that is missing or broken.

    `read` has the tables of a model's file where the nodes hold none; `tables_of` if not given.
    """
    if material is None:
        return Appearance()
    packed = _packed_appearance(material.original, final)
    if packed is not None:
        return packed
    # Setting these does not bring the evaluated copy up to date.
    settings = getattr(material.original, "nacre", None)
    path = getattr(settings, "model", "")
    if final:
        path = getattr(settings, "final_model", "") or path
    if not path:
        return Appearance(base=base_colour(material))
    tables, message = (read or tables_of)(bpy.path.abspath(path, library=material.library))
    if tables is None:
        return Appearance(base=(0.4, 0.4, 0.4), message=f"{material.name}: {message}")
    lights = settings.lights.name if settings.lights is not None else ""
    if tables.light is None:
        return Appearance(
            occlusion=tables, lights=lights, repeat=_repeat(material), base=base_colour(material)
        )
    return Appearance(btf=tables, lights=lights, repeat=_repeat(material))


def _packed_appearance(material: bpy.types.Material, final: bool) -> Appearance | None:
    """What the material's own node groups hold, as EEVEE and Cycles show it: no file is read."""
    try:
        from ..nodes.material import COVERAGE_NODE, FINAL_NODE, MODEL_NODE
        from ..nodes.sparse_blend import MIX
    except ImportError:  # without the compiled packages
        return None
    nodes = material.node_tree.nodes if material.node_tree is not None else {}
    names = (FINAL_NODE, MODEL_NODE) if final else (MODEL_NODE,)
    node = next((nodes.get(name) for name in names if nodes.get(name) is not None), None)
    btf = None if node is None else _unpacked(node.node_tree)
    if btf is None:
        return None
    btf, weights, message = _blended(node, btf)
    mix = node.inputs.get(MIX) if weights else None
    note = ""
    if mix is not None and mix.is_linked:
        note = f"{material.name}: mixed by {mix.default_value:.2g} all over, not by what is linked"
    coverage = nodes.get(COVERAGE_NODE)
    occlusion, visibility = None, Appearance.visibility
    if coverage is not None:
        occlusion = _unpacked(coverage.node_tree)
        visibility = tuple(coverage.inputs[name].default_value for name in ("Threshold", "Weight"))
    return Appearance(
        btf=btf,
        occlusion=occlusion,
        world=_world_light(node.node_tree),
        coordinates=_coordinates(node.node_tree),
        lights=_lights(node.node_tree),
        visibility=visibility,
        repeat=_repeat(material),
        weights=weights,
        message=message and f"{material.name}: {message}",
        note=note,
    )


def _lights(tree: bpy.types.ShaderNodeTree) -> str:
    """The collection whose lights a node group shows; "" for a scene's."""
    from ..nodes.light_set import owner_of
    from ..nodes.model_group import lights_of

    lights = lights_of(tree)
    owner = None if lights is None else owner_of(lights)
    return owner.name if isinstance(owner, bpy.types.Collection) else ""


# What node groups keep is read from images once, and is the same object until they change.


def _unpacked(tree: bpy.types.ShaderNodeTree | None) -> Tables | SparseLayout | None:
    """The tables that a node group keeps, or None."""
    from ..nodes.packed_tables import is_packed

    return _unpack(tree.name_full, _images(tree)) if is_packed(tree) else None


def _images(tree: bpy.types.ShaderNodeTree) -> tuple[int, ...]:
    from ..nodes.packed_tables import stored

    return tuple(atlas.image.session_uid for atlas in stored(tree).atlases.values())


@lru_cache(maxsize=KEPT)
def _unpack(name: str, _images: tuple[int, ...]) -> Tables | SparseLayout:
    from ..nodes.packed_tables import stored, unpack

    return laid_out(unpack(stored(_group(name))))


def _blended(
    node: bpy.types.ShaderNodeGroup, alone: Tables | SparseLayout
) -> tuple[Tables | SparseLayout, tuple[float, ...], str]:
    """The blend that a material's node shows and its weights, or a model alone; and why where the
    engine cannot mix them."""
    from ..nodes.sparse_blend import MIX, blended_with

    second = blended_with(node.node_tree)
    if second is None:
        return alone, (), ""
    images = tuple(atlas.image.session_uid for atlas in second.atlases.values())
    try:
        both = _unpack_blend(node.node_tree.name_full, _images(node.node_tree), images)
    except NacreError as error:
        return alone, (), f"shown unmixed ({error})"
    mix = node.inputs[MIX].default_value
    return both, (1.0 - mix, mix), ""


@lru_cache(maxsize=KEPT)
def _unpack_blend(
    name: str, _first: tuple[int, ...], _second: tuple[int, ...]
) -> Tables | SparseLayout:
    from ..nodes.packed_tables import stored, unpack
    from ..nodes.sparse_blend import blended_with

    tree = _group(name)
    return laid_out(unpack(stored(tree)), unpack(blended_with(tree)))


def _world_light(tree: bpy.types.ShaderNodeTree) -> WorldLight | None:
    """The world's light that a node group keeps, or None."""
    from ..nodes.packed_environment import stored_environment

    packed = stored_environment(tree)
    if packed is None:
        return None
    table = _unpack_world(tree.name_full, packed.atlas.image.session_uid, packed.stamp)
    return WorldLight(table, packed.world, packed.mapping)


@lru_cache(maxsize=KEPT)
def _unpack_world(name: str, _image: int, _stamp: int) -> EnvironmentTable:
    from ..nodes.packed_environment import stored_environment, unpack_environment
    from ..nodes.packed_tables import stored

    tree = _group(name)
    return unpack_environment(stored_environment(tree), stored(tree).shapes)


def _coordinates(tree: bpy.types.ShaderNodeTree) -> NDArray[np.integer] | None:
    """The map of coordinates that a node group keeps, or None."""
    from ..nodes.coordinates import stored_coordinates

    image = stored_coordinates(tree)
    return None if image is None else _read_coordinates(tree.name_full, image.session_uid)


@lru_cache(maxsize=KEPT)
def _read_coordinates(name: str, _image: int) -> NDArray[np.integer]:
    from ..nodes.coordinates import read_coordinates, stored_coordinates

    return read_coordinates(stored_coordinates(_group(name)))


def _group(name: str) -> bpy.types.ShaderNodeTree:
    return next(tree for tree in bpy.data.node_groups if tree.name_full == name)


def tables_of(path: str) -> Read:
    """The tables of a model file, or None and why it cannot be shown; kept until it changes."""
    file = find_model(path)
    return (None, f"{path}: no such model file") if file is None else read_tables(file)


class ModelFile(NamedTuple):
    """A file as it was at a time."""

    path: str
    time: int
    size: int


def find_model(path: str) -> ModelFile | None:
    """A model's file as it is now, or None."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return ModelFile(path, found.st_mtime_ns, found.st_size)


@lru_cache(maxsize=KEPT)
def read_tables(file: ModelFile) -> Read:
    """The tables of a file, or None and why it cannot be shown; touches nothing of Blender's."""
    try:
        from ..models.any_model import load_any
        from ..tables.any_tables import build_any_tables

        return laid_out(build_any_tables(load_any(file.path))), ""
    except (NacreError, ImportError, OSError) as error:
        return None, str(error)


def base_colour(material: bpy.types.Material) -> tuple[float, float, float]:
    """The colour of a Principled BSDF that no texture feeds, or that of the viewport."""
    tree = material.node_tree
    for node in tree.nodes if tree is not None else ():
        if node.type == "BSDF_PRINCIPLED" and not node.inputs["Base Color"].is_linked:
            return tuple(node.inputs["Base Color"].default_value[:3])
    return tuple(material.diffuse_color[:3])


def _repeat(material: bpy.types.Material) -> tuple[float, float]:
    """What the material's node tree multiplies its UV map with."""
    node = material.node_tree.nodes.get("Repeat") if material.node_tree is not None else None
    return tuple(node.inputs[1].default_value[:2]) if node is not None else (1.0, 1.0)
