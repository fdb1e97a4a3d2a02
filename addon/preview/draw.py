"""A scene drawn with Nacre's shaders into the bound frame buffer."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import bpy
import gpu
import numpy as np
from mathutils import Matrix, Vector

from ..nodes.turning import rotation_of
from .appearance import Appearance, WorldLight
from .lights import LIGHTS, collection_lights, light_rows, scene_lights
from .mesh import MeshBatches, mesh_batches
from .shader import Constants, constants, four, let_go
from .shadow_maps import SIZE, draw_shadow_maps
from .surface_shader import depth_shader, holes_shader, surface_shader
from .textures import Uploaded, upload, upload_coordinates, upload_masks, upload_world
from .view import View

DRAWN = {"MESH", "CURVE", "SURFACE", "META", "FONT"}
CHECKS = 10.0
"""Checks of the placeholder along a metre."""


@dataclass
class Resources:
    """What stays on the graphics card from one picture to the next.

    Tables, worlds' lights and maps of coordinates are kept by their identity, together with
    themselves so that it cannot be used again.
    """

    meshes: dict[tuple, MeshBatches | None] = field(default_factory=dict)
    textures: dict[int, tuple[object, Uploaded]] = field(default_factory=dict)
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
    """Triangles of one material, at a place in the world; `block` has the material's uniforms."""

    batch: gpu.types.GPUBatch
    matrix: Matrix
    appearance: Appearance
    block: gpu.types.GPUUniformBuf


@dataclass(frozen=True)
class Prepared:
    """What is the same in all views of a scene: `lights` by the names of their collections, "" for
    the scene's own, of which there are `count`. `messages` are for the engine's status line."""

    items: tuple[Item, ...]
    world: tuple[float, float, float]
    count: int
    lights: dict[str, gpu.types.GPUUniformBuf]
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
    _forget_textures(resources, items)
    lights = {"": scene_lights(depsgraph)}
    for name in {item.appearance.lights for item in items} - {""}:
        collection = bpy.data.collections.get(name)
        lights[name] = collection_lights(collection, depsgraph) if collection else []
    messages = sorted(
        {text for item in items for text in (item.appearance.message, item.appearance.note)} - {""}
    )
    messages += [
        f"{len(several)} lights: the first {LIGHTS} are drawn"
        for several in lights.values()
        if len(several) > LIGHTS
    ]
    boxes = np.array([box for _, box in found]) if found else np.zeros((1, 2, 3))
    shadows = draw_shadow_maps(
        [light for several in lights.values() for light in several[:LIGHTS]] if items else [],
        np.stack([boxes[:, 0].min(0), boxes[:, 1].max(0)]),
        lambda view: _draw_depth(items, view, resources),
    )
    blocks = {}
    if shadows.maps is not None:
        blocks["nacre_shadow_views"] = _uniforms(shadows.views)
    return Prepared(
        items,
        world_colour(depsgraph.scene.world),
        len(lights[""]),
        {name: _uniforms(light_rows(several, shadows.places)) for name, several in lights.items()},
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
    camera = _camera(view, scene.world)
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    gpu.state.blend_set("NONE")
    for item in scene.items:
        _draw_item(item, False, camera, scene, resources)
    gpu.state.depth_mask_set(False)
    gpu.state.blend_set("ALPHA_PREMULT")
    for item in scene.items:
        if item.appearance.occlusion is not None:
            _draw_item(item, True, camera, scene, resources)
    gpu.state.depth_mask_set(True)
    gpu.state.blend_set("NONE")
    gpu.state.depth_test_set("NONE")
    let_go()


def table_bytes(resources: Resources) -> int:
    """What tables take on the graphics card."""
    return sum(uploaded.bytes for _, uploaded in resources.textures.values())


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
    looks: dict[int, tuple[Appearance, gpu.types.GPUUniformBuf]] = {}
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
            key = 0 if material is None else material.original.session_uid
            if key not in looks:
                appearance = appearance_of(material)
                looks[key] = appearance, _material_block(appearance, depsgraph)
            yield Item(batch, matrix, *looks[key]), box


def _corner(bounds: np.ndarray, number: int) -> tuple[float, ...]:
    return tuple(bounds[number >> axis & 1, axis] for axis in range(3))


def _material_block(
    appearance: Appearance, depsgraph: bpy.types.Depsgraph
) -> gpu.types.GPUUniformBuf:
    turn = np.eye(4)
    if appearance.world is not None:
        turn[:3, :3] = _turn(appearance.world, depsgraph)
    checks = CHECKS if appearance.message else 0.0
    return _uniforms(turn.T, (*appearance.base, checks), (*appearance.repeat, 0.0, 0.0))


def _turn(light: WorldLight, depsgraph: bpy.types.Depsgraph) -> np.ndarray:
    """The matrix (3, 3) from directions in the scene to those of a world's light."""
    world = bpy.data.worlds.get(light.world)
    tree = None if world is None else world.evaluated_get(depsgraph).node_tree
    return rotation_of(None if tree is None else tree.nodes.get(light.mapping))


def _draw_item(
    item: Item,
    blended: bool,
    camera: gpu.types.GPUUniformBuf,
    scene: Prepared,
    resources: Resources,
) -> None:
    shadow_size = SIZE if scene.shadow_maps is not None else 0
    shapes = _shapes(item.appearance)
    key = (shadow_size, *((name, *shape.items()) for name, shape in shapes.items()))
    shader = resources.shader(
        key,
        lambda: surface_shader(shapes.get("BTF"), shapes.get("OCCLUSION"), shadow_size),
    )
    shader.bind()
    for name in shapes:
        _bind_tables(shader, name, item.appearance, resources)
    lights = {"nacre_lights": scene.lights[item.appearance.lights]}
    for name, block in {**scene.blocks, **lights}.items():
        shader.uniform_block(name, block)
    if scene.shadow_maps is not None:
        shader.uniform_sampler("nacre_shadow_maps", scene.shadow_maps)
    _draw_batch(shader, item, blended, camera)


def _draw_depth(items: Sequence[Item], view: View, resources: Resources) -> None:
    """What a light sees: all of what is solid, and where the rest has no holes."""
    camera = _camera(view, (0.0, 0.0, 0.0))
    solid = resources.shader("depth", depth_shader)
    solid.bind()
    for item in items:
        if item.appearance.occlusion is None:
            solid.uniform_float("nacre_projection", view.projection @ item.matrix)
            item.batch.draw(solid)
    for item in items:
        if item.appearance.occlusion is not None:
            shape = _shapes(item.appearance)["OCCLUSION"]
            shader = resources.shader(("holes", *shape.items()), partial(holes_shader, shape))
            shader.bind()
            _bind_tables(shader, "OCCLUSION", item.appearance, resources)
            _draw_batch(shader, item, False, camera)


def _draw_batch(
    shader: gpu.types.GPUShader, item: Item, blended: bool, camera: gpu.types.GPUUniformBuf
) -> None:
    shader.uniform_block("nacre_camera", camera)
    shader.uniform_block("nacre_material", item.block)
    shader.uniform_float("nacre_object", item.matrix)
    if item.appearance.occlusion is not None:
        visibility = (*item.appearance.visibility, float(blended), 0.0)
        shader.uniform_float("nacre_visibility", visibility)
    item.batch.draw(shader)


def _shapes(appearance: Appearance) -> dict[str, Constants]:
    """The constants of each set of tables that a material has."""
    shapes = {}
    if appearance.btf is not None:
        world = appearance.world.table if appearance.world is not None else None
        masked = appearance.masks is not None
        shapes["BTF"] = constants(appearance.btf, world, appearance.coordinates, masked)
    if appearance.occlusion is not None:
        shapes["OCCLUSION"] = constants(appearance.occlusion, None, appearance.coordinates)
    return shapes


def _bind_tables(
    shader: gpu.types.GPUShader, name: str, appearance: Appearance, resources: Resources
) -> None:
    tables = appearance.btf if name == "BTF" else appearance.occlusion
    uploaded = _uploaded(resources, tables, upload)
    textures = dict(uploaded.textures)
    if appearance.coordinates is not None:
        textures |= _uploaded(resources, appearance.coordinates, upload_coordinates).textures
    if name == "BTF" and appearance.world is not None:
        table = appearance.world.table
        textures |= _uploaded(resources, table, upload_world).textures
        shader.uniform_float(f"{name}_world_scale", uploaded.core_scale * table.scale)
    if name == "BTF" and len(appearance.weights) > 1:
        shader.uniform_float(f"{name}_weights", four(appearance.weights))
        if appearance.masks is not None:
            masks = _uploaded(
                resources, appearance.masks, lambda held: upload_masks(held, appearance.btf)
            )
            textures |= masks.textures
    for texture, held in textures.items():
        shader.uniform_sampler(f"{name}_{texture}", held)
    for number, value in uploaded.numbers.items():
        shader.uniform_float(f"{name}_{number}", value)


def _uploaded(resources: Resources, held: object, upload: Callable[[Any], Any]) -> Any:
    if id(held) not in resources.textures:
        resources.textures[id(held)] = held, upload(held)
    return resources.textures[id(held)][1]


def _forget_textures(resources: Resources, items: Sequence[Item]) -> None:
    """Give back the textures of models that the scene no longer shows."""
    shown = set()
    for look in (item.appearance for item in items):
        world = look.world and look.world.table
        held = (look.btf, look.occlusion, look.coordinates, look.masks, world)
        shown |= {id(own) for own in held}
    for key in set(resources.textures) - shown:
        del resources.textures[key]


def _camera(view: View, world: tuple[float, float, float]) -> gpu.types.GPUUniformBuf:
    return _uniforms(np.array(view.projection).T, view.viewer, (*world, 0.0))


def _uniforms(*parts) -> gpu.types.GPUUniformBuf:
    data = np.concatenate([np.ravel(np.asarray(part, np.float32)) for part in parts])
    return gpu.types.GPUUniformBuf(gpu.types.Buffer("FLOAT", data.size, data))
