"""A scene drawn with Nacre's shaders into the bound frame buffer."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, field

import bpy
import gpu
import numpy as np
from mathutils import Matrix, Vector

from .appearance import Appearance
from .lights import LIGHTS, light_rows, scene_lights
from .mesh import MeshBatches, mesh_batches
from .shader import constants, let_go
from .shadow_maps import SIZE, draw_shadow_maps
from .surface_shader import depth_shader, surface_shader
from .textures import TableTextures, upload

DRAWN = {"MESH", "CURVE", "SURFACE", "META", "FONT"}
CHECKS = 10.0
"""Checks of the placeholder along a metre."""


@dataclass(frozen=True)
class View:
    """World to clip space, and where the viewer is: a point with 1, or a direction with 0, as
    homogeneous coordinates of the world."""

    projection: Matrix
    viewer: tuple[float, float, float, float]

    @classmethod
    def of(cls, world_to_view: Matrix, window: Matrix) -> View:
        """From Blender's view and window matrices."""
        back = world_to_view.inverted()
        perspective = window[3][3] == 0.0
        viewer = back.translation if perspective else back.col[2].xyz
        return cls(window @ world_to_view, (*viewer, 1.0 if perspective else 0.0))


@dataclass
class Resources:
    """What stays on the graphics card from one picture to the next.

    Tables are kept by their identity, together with themselves so that it cannot be used again.
    """

    meshes: dict[tuple, MeshBatches | None] = field(default_factory=dict)
    tables: dict[int, tuple[object, TableTextures]] = field(default_factory=dict)
    shaders: dict[Hashable, gpu.types.GPUShader] = field(default_factory=dict)

    def shader(
        self, key: Hashable, build: Callable[[], gpu.types.GPUShader]
    ) -> gpu.types.GPUShader:
        """The shader of a key, built at first use."""
        if key not in self.shaders:
            self.shaders[key] = build()
        return self.shaders[key]


@dataclass(frozen=True)
class Item:
    """Triangles of one material, at a place in the world."""

    batch: gpu.types.GPUBatch
    matrix: Matrix
    appearance: Appearance


@dataclass(frozen=True)
class Prepared:
    """What is the same in all views of a scene; `messages` are for the engine's status line."""

    items: tuple[Item, ...]
    world: tuple[float, float, float]
    lights: int
    blocks: dict[str, gpu.types.GPUUniformBuf]
    shadow_maps: gpu.types.GPUTexture | None
    messages: tuple[str, ...]


def prepare(
    depsgraph: bpy.types.Depsgraph,
    resources: Resources,
    appearance_of: Callable[[bpy.types.Material | None], Appearance],
) -> Prepared:
    """Read what a depsgraph holds and draw the lights' shadow maps.

    To be called where no other frame buffer is bound.
    """
    found = list(_items(depsgraph, resources, appearance_of))
    items = tuple(item for item, _ in found)
    lights = scene_lights(depsgraph)
    messages = sorted({item.appearance.message for item in items} - {""})
    if len(lights) > LIGHTS:
        messages.append(f"{len(lights)} lights: the first {LIGHTS} are drawn")
        lights = lights[:LIGHTS]
    boxes = np.array([box for _, box in found]) if found else np.zeros((1, 2, 3))
    shadows = draw_shadow_maps(
        lights,
        [(item.batch, item.matrix) for item in items],
        np.stack([boxes[:, 0].min(0), boxes[:, 1].max(0)]),
        resources.shader("depth", depth_shader),
    )
    blocks = {"nacre_lights": _uniforms(light_rows(lights, shadows.layers, shadows.texels))}
    if shadows.maps is not None:
        blocks["nacre_shadow_views"] = _uniforms(shadows.views)
    _forget_tables(resources, items)
    return Prepared(
        items,
        world_colour(depsgraph.scene.world),
        len(lights),
        blocks,
        shadows.maps,
        tuple(messages),
    )


def draw(scene: Prepared, view: View, resources: Resources) -> None:
    """Draw into the bound frame buffer: opaque surfaces, then what is partly visible (K-CTA,
    Section 6.3.3).

    Depth must be cleared. Colours are linear, with premultiplied alpha.
    Raises NacreError when tables do not fit textures.
    """
    camera = _uniforms(
        np.array(view.projection).T, view.viewer, (*scene.world, float(scene.lights))
    )
    blocks = {"nacre_camera": camera, **scene.blocks}
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    gpu.state.blend_set("NONE")
    for item in scene.items:
        _draw_item(item, False, blocks, scene.shadow_maps, resources)
    gpu.state.depth_mask_set(False)
    gpu.state.blend_set("ALPHA_PREMULT")
    for item in scene.items:
        if item.appearance.occlusion is not None:
            _draw_item(item, True, blocks, scene.shadow_maps, resources)
    gpu.state.depth_mask_set(True)
    gpu.state.blend_set("NONE")
    gpu.state.depth_test_set("NONE")
    let_go()


def table_bytes(resources: Resources) -> int:
    """What tables take on the graphics card."""
    return sum(kept.bytes for _, kept in resources.tables.values())


def world_colour(world: bpy.types.World | None) -> tuple[float, float, float]:
    """The plain colour of a world's background."""
    if world is None:
        return (0.0, 0.0, 0.0)
    for node in world.node_tree.nodes if world.node_tree is not None else ():
        if node.type == "BACKGROUND":
            strength = node.inputs["Strength"].default_value
            return tuple(part * strength for part in node.inputs["Color"].default_value[:3])
    return tuple(world.color)


def _items(
    depsgraph: bpy.types.Depsgraph,
    resources: Resources,
    appearance_of: Callable[[bpy.types.Material | None], Appearance],
) -> Iterator[tuple[Item, np.ndarray]]:
    """The batches of all objects, each with its bounding box (2, 3) in the world."""
    kept, resources.meshes = resources.meshes, {}  # those of objects that are gone are given back
    for instance in depsgraph.object_instances:
        item = instance.object
        if item.type not in DRAWN or not instance.show_self:
            continue
        key = (item.original.session_uid, item.data.name_full)
        if key not in resources.meshes:
            resources.meshes[key] = kept[key] if key in kept else mesh_batches(item)
        mesh = resources.meshes[key]
        if mesh is None:
            continue
        matrix = instance.matrix_world.copy()
        corners = [matrix @ Vector(_corner(mesh.bounds, number)) for number in range(8)]
        box = np.stack([np.min(corners, 0), np.max(corners, 0)])
        for slot, batch in mesh.batches:
            slots = item.material_slots
            material = slots[min(slot, len(slots) - 1)].material if len(slots) else None
            yield Item(batch, matrix, appearance_of(material)), box


def _corner(bounds: np.ndarray, number: int) -> tuple[float, ...]:
    return tuple(bounds[number >> axis & 1, axis] for axis in range(3))


def _draw_item(
    item: Item,
    blended: bool,
    blocks: dict[str, gpu.types.GPUUniformBuf],
    shadow_maps: gpu.types.GPUTexture | None,
    resources: Resources,
) -> None:
    shadow_size = SIZE if shadow_maps is not None else 0
    appearance = item.appearance
    sets = {
        name: tables
        for name, tables in (("BTF", appearance.btf), ("OCCLUSION", appearance.occlusion))
        if tables is not None
    }
    shapes = {name: constants(tables) for name, tables in sets.items()}
    key = (shadow_size, *((name, *shape.items()) for name, shape in shapes.items()))
    shader = resources.shader(
        key,
        lambda: surface_shader(shapes.get("BTF"), shapes.get("OCCLUSION"), shadow_size),
    )
    shader.bind()
    for name, tables in sets.items():
        uploaded = _uploaded(resources, tables)
        for texture, held in uploaded.textures.items():
            shader.uniform_sampler(f"{name}_{texture}", held)
        shader.uniform_float(f"{name}_scale", uploaded.scale)
    for name, block in blocks.items():
        shader.uniform_block(name, block)
    if shadow_maps is not None:
        shader.uniform_sampler("nacre_shadow_maps", shadow_maps)
    shader.uniform_float("nacre_object", item.matrix)
    if "BTF" not in sets:
        checks = CHECKS if appearance.message else 0.0
        shader.uniform_float("nacre_base", (*appearance.base, checks))
    if "OCCLUSION" in sets:
        shader.uniform_float("nacre_visibility", (*appearance.visibility, float(blended), 0.0))
    if sets:
        shader.uniform_float("nacre_repeat", appearance.repeat)
    item.batch.draw(shader)


def _uploaded(resources: Resources, tables) -> TableTextures:
    if id(tables) not in resources.tables:
        resources.tables[id(tables)] = (tables, upload(tables))
    return resources.tables[id(tables)][1]


def _forget_tables(resources: Resources, items: tuple[Item, ...]) -> None:
    """Give back the textures of models that the scene no longer shows."""
    shown = {
        id(tables)
        for item in items
        for tables in (item.appearance.btf, item.appearance.occlusion)
        if tables is not None
    }
    for key in set(resources.tables) - shown:
        del resources.tables[key]


def _uniforms(*parts) -> gpu.types.GPUUniformBuf:
    data = np.concatenate([np.ravel(np.asarray(part, np.float32)) for part in parts])
    return gpu.types.GPUUniformBuf(gpu.types.Buffer("FLOAT", data.size, data))
