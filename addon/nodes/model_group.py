"""The node group that shows a model under the lights of a light set.

Nacre MODEL          UV, View, Tangent, Bitangent, Normal -> Value
  Nacre Lights       directions and radiances (light_set)
  Nacre MODEL Texel  the core of a tensor model at one texel (texel_group)
"""

from __future__ import annotations

from dataclasses import replace

import bpy

from ..tables.environment import EnvironmentTable
from .coordinates import store_coordinates, stored_coordinates
from .environment_light import environment_radiance
from .evaluation import Evaluation
from .graph import Graph, Wire
from .light_set import key_of
from .loops import choose, clear, has_zones, repeat
from .packed_environment import (
    PackedEnvironment,
    pack_environment,
    refill_environment,
    stamp_of,
    store_environment,
    stored_environment,
)
from .packed_sparse import PackedSparse
from .packed_tables import HOLDER, Packed, is_holder, is_packed, is_sparse, store, stored
from .packed_tensor import PackedTensor
from .sparse_blend import MIX, blended_with, goes_with, store_blended
from .sparse_evaluation import SparseAverage, SparseEvaluation, colour_of, nearest_texel
from .sparse_script import SparseScript, follow_files
from .texel_group import make_texel_group
from .turning import follow_world, turned

SOCKETS = (
    ("UV", "Texture coordinates in patches; whole numbers repeat the material"),
    ("View", "Unit direction to the viewer: x tangent, y bitangent, z normal"),
    ("Tangent", "Unit vector of the surface along +u, in the world"),
    ("Bitangent", "Unit vector of the surface on the side of +v, in the world"),
    ("Normal", "Unit normal of the surface, in the world"),
)
OUTPUTS = (
    ("Value", "Linear radiance of the material under all lights"),
    ("Cycles", "The same as Cycles can evaluate it: of a sparse model, by a script"),
)
_TEXEL = f"{HOLDER}Texel"
_STAND_IN = "Stand-In "
_LIGHTS = "Lights"
_PARTED = "nacre_parted_from"
_SCALE = "World Scale"


def make_model_group(
    name: str,
    packed: Packed,
    lights: bpy.types.ShaderNodeTree | None,
    stand_in: PackedTensor | None = None,
) -> bpy.types.ShaderNodeTree:
    """A group with inputs SOCKETS and OUTPUTS: linear radiance under all lights of a light set,
    that of the material clamped at 0 for each."""
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    for label, tip in SOCKETS:
        socket = tree.interface.new_socket(label, in_out="INPUT", socket_type="NodeSocketVector")
        socket.description = tip
    show_tables(tree, packed, lights, stand_in)
    return tree


def show_tables(
    tree: bpy.types.ShaderNodeTree,
    packed: Packed,
    lights: bpy.types.ShaderNodeTree | None,
    stand_in: PackedTensor | None = None,
) -> None:
    """Let a group show other tables; its sockets, and so all links to it, stay. `stand_in` is what
    EEVEE shows in place of a sparse model where it cannot loop."""
    for label, tip in OUTPUTS:
        if label not in tree.interface.items_tree:
            socket = tree.interface.new_socket(
                label, in_out="OUTPUT", socket_type="NodeSocketColor"
            )
            socket.description = tip
    holder = tree.nodes.get(_TEXEL)
    if holder is not None:
        bpy.data.node_groups.remove(holder.node_tree)
        tree.nodes.remove(holder)
    store(tree, packed)
    store(tree, stand_in, _STAND_IN)
    store_environment(tree, None)  # it was convolved with other rows
    if not goes_with(packed, blended_with(tree)):
        store_blended(tree, None)
    tensor = packed if isinstance(packed, PackedTensor) else stand_in
    if tensor is not None:
        holder = tree.nodes.new("ShaderNodeGroup")
        holder.node_tree = make_texel_group(f"{tree.name} Texel", tensor)
        holder.name = holder.label = _TEXEL
        holder.location, holder.hide = (-400.0, 60.0), True
    show_lights(tree, lights)


def remove_model_group(tree: bpy.types.ShaderNodeTree) -> None:
    """Remove a group with all that was made for it."""
    clear(tree, keep=is_holder)
    texels = [node.node_tree for node in tree.nodes if node.name == _TEXEL]
    images = [node.image for node in tree.nodes if node.type == "TEX_IMAGE"]
    for item in (tree, *texels):
        bpy.data.node_groups.remove(item)
    for image in images:
        bpy.data.images.remove(image)


def show_environment(
    tree: bpy.types.ShaderNodeTree, table: EnvironmentTable | None, world: str, mapping: str
) -> None:
    """Add a world's light to that of the lights, in place of what was there before; None for none.

    The node `mapping` of `world` turns it, live. Another table of the same shape takes the place of
    the last one without compiling.
    """
    before = stored_environment(tree)
    if table is not None and before is not None:
        same = (before.world, before.mapping) == (world, mapping)
        if same and refill_environment(before, table):
            store_environment(tree, replace(before, scale=table.scale, stamp=stamp_of(table)))
            tree.nodes[_SCALE].outputs[0].default_value = table.scale
            return
    packed = None
    if table is not None:
        packed = pack_environment(f"{tree.name} Environment", table, world, mapping)
    store_environment(tree, packed)
    show_lights(tree, lights_of(tree))


def show_lights(tree: bpy.types.ShaderNodeTree, lights: bpy.types.ShaderNodeTree | None) -> None:
    """Write a group anew for a light set, or for one whose number of lights has changed."""
    clear(tree, keep=is_holder)
    tree.animation_data_clear()
    tree.pop(_PARTED, None)
    _write(tree, stored(tree), lights)


def show_coordinates(tree: bpy.types.ShaderNodeTree, image: bpy.types.Image | None) -> None:
    """Lay the material by a map of coordinates, or repeat the patch."""
    store_coordinates(tree, image)
    show_lights(tree, lights_of(tree))


def follow_turned_world(tree: bpy.types.ShaderNodeTree) -> None:
    """Let a group's environment follow an edit of its world's rotation."""
    environment = stored_environment(tree)
    world = bpy.data.worlds.get(environment.world) if environment else None
    if world is None or world.node_tree is None or tree.animation_data is None:
        return
    mapping = world.node_tree.nodes.get(environment.mapping)
    here = next((node for node in tree.nodes if node.type == "MAPPING"), None)
    if mapping is not None and here is not None:
        follow_world(world, mapping, here)


def follow_scripts(tree: bpy.types.ShaderNodeTree) -> None:
    """Write the files that a group's scripts read where this session has not yet."""
    if is_sparse(tree):
        blended = blended_with(tree)
        follow_files(tree, [stored(tree), *([blended] if blended else [])])


def show_blended(tree: bpy.types.ShaderNodeTree, packed: PackedSparse | None) -> None:
    """Mix a sparse model with another one, by an input Mix; None for none."""
    store_blended(tree, packed)
    show_lights(tree, lights_of(tree))


def lights_of(tree: bpy.types.ShaderNodeTree) -> bpy.types.ShaderNodeTree | None:
    """The light set that a group shows."""
    node = tree.nodes.get(_LIGHTS)
    return None if node is None else node.node_tree


def part_from_lights(tree: bpy.types.ShaderNodeTree) -> None:
    """Let a group remember whose lights it shows, in place of showing them."""
    lights = lights_of(tree)
    if lights is not None:
        tree[_PARTED] = key_of(lights)
        tree.nodes[_LIGHTS].node_tree = None


def parted_from(tree: bpy.types.ShaderNodeTree) -> str | None:
    """What names the light set that a group was parted from."""
    return tree.get(_PARTED)


def _write(
    tree: bpy.types.ShaderNodeTree,
    packed: Packed,
    lights: bpy.types.ShaderNodeTree | None,
) -> None:
    g = Graph(tree)
    inputs = g.node("NodeGroupInput")
    uv, view, *frame = (g.wire(inputs, label) for label, _ in SOCKETS)
    directions: list[Wire] = []
    radiances: list[Wire] = []
    if lights is not None:
        node = g.node("ShaderNodeGroup", node_tree=lights)
        node.name = node.label = _LIGHTS
        outputs = [Wire(g, output) for output in node.outputs]
        directions, radiances = outputs[::2], outputs[1::2]
    if isinstance(packed, PackedSparse):
        values = _lit_sparse(g, packed, inputs, directions, radiances)
    else:
        total = _lit_tensor(g, packed, uv, view, frame, directions, radiances)
        values = [total, total]
    g.node("NodeGroupOutput", *values)


def _lit_tensor(
    g: Graph,
    packed: PackedTensor,
    uv: Wire,
    view: Wire,
    frame: list[Wire],
    directions: list[Wire],
    radiances: list[Wire],
) -> Wire:
    """The radiance under all lights and the world."""
    total = g.combine(0.0, 0.0, 0.0)
    environment = stored_environment(g.tree)
    if directions or environment:
        texel_group = g.tree.nodes[_TEXEL].node_tree
        evaluation = Evaluation(g, packed, texel_group, uv, view, stored_coordinates(g.tree))
    if directions:

        def add_light(g: Graph, index: Wire | int, state: list[Wire]) -> list[Wire]:
            direction = choose(g, index, directions)
            value = evaluation.value(g, in_frame(g, direction, frame))
            radiance = choose(g, index, radiances)
            lit = g.node(
                "ShaderNodeVectorMath", g.combine(*value), radiance, operation="MULTIPLY_ADD"
            )
            g.connect(state[0], lit.inputs[2])
            return [g.wire(lit)]

        (total,) = repeat(g, len(directions), [(0.0, 0.0, 0.0)], add_light)
    if environment:
        total = total + _from_world(g, evaluation, environment, frame)
    return total


def _lit_sparse(
    g: Graph,
    packed: PackedSparse,
    inputs: bpy.types.Node,
    directions: list[Wire],
    radiances: list[Wire],
) -> list[Wire]:
    """The radiance under all lights for each of OUTPUTS."""
    uv, view, *frame = (g.wire(inputs, label) for label, _ in SOCKETS)
    if not directions:
        black = g.combine(0.0, 0.0, 0.0)
        return [black, black]
    lights = [in_frame(g, direction, frame) for direction in directions]
    mixed = [packed]
    blended = blended_with(g.tree)
    if blended is not None:
        mixed.append(blended)
    texels = [nearest_texel(g, uv, own.shapes, stored_coordinates(g.tree)) for own in mixed]

    def lit(evaluator: type[SparseEvaluation | SparseScript | SparseAverage]) -> Wire:
        values, *others = (
            evaluator(g, own, texel, view).log_values(g, lights)
            for own, texel in zip(mixed, texels, strict=True)
        )
        lowest: Wire | float = packed.shapes.lowest
        for other in others:
            mix = g.wire(inputs, MIX)
            values = [a + (b - a) * mix for a, b in zip(values, other, strict=True)]
            lowest = g.math("MULTIPLY_ADD", mix, blended.shapes.lowest - lowest, lowest)
        total = g.combine(0.0, 0.0, 0.0)
        for own, light, radiance in zip(values, lights, radiances, strict=True):
            colour = colour_of(g, own, packed.shapes.offset, lowest, light)
            total = total + g.operate("MULTIPLY", colour, radiance)
        return total

    if has_zones():
        return [lit(SparseEvaluation), lit(SparseScript)]
    if is_packed(g.tree, _STAND_IN):
        stand_in = stored(g.tree, _STAND_IN)
        shown = _lit_tensor(g, stand_in, uv, view, frame, directions, radiances)
        return [shown, lit(SparseScript)]
    return [lit(SparseAverage), lit(SparseScript)]


def in_frame(g: Graph, direction: Wire, frame: list[Wire]) -> Wire:
    """A direction of the world in the tangent frame."""
    return g.combine(*(g.dot(direction, axis) for axis in frame))


def _from_world(
    g: Graph, evaluation: Evaluation, environment: PackedEnvironment, frame: list[Wire]
) -> Wire:
    """The radiance under a world that turns as its own node for that does."""
    world = bpy.data.worlds.get(environment.world)
    if world is not None and world.node_tree is not None:
        mapping = world.node_tree.nodes.get(environment.mapping)
        if mapping is not None:
            frame = turned(g, frame, world, mapping)
    values = environment_radiance(g, evaluation, environment, *frame)
    scale = g.node("ShaderNodeValue")
    scale.name = scale.label = _SCALE
    scale.outputs[0].default_value = environment.scale
    return g.combine(*values) * g.wire(scale)
