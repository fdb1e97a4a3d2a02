"""A material that shows a model under the lights of a scene."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from ..errors import NacreError
from ..tables.any_tables import AnyTables
from ..tables.environment import EnvironmentTable
from ..tables.sparse_tables import SparseTables
from ..tables.tables import Tables
from .coordinates import make_coordinates, stored_coordinates
from .coverage_group import lay_coverage, make_coverage_group, remove_coverage_group
from .frame_group import frame_group
from .graph import Graph, Wire
from .kept_world import KeptWorld, keep_world, kept_world
from .light_set import Owner, bring_up_to_date, light_set
from .model_group import (
    lights_of,
    make_model_group,
    remove_model_group,
    show_blended,
    show_coordinates,
    show_environment,
    show_lights,
    show_tables,
)
from .packed_sparse import pack_sparse
from .packed_tables import Packed, is_packed, is_sparse, pack, stored, unpack
from .packed_tensor import PackedTensor, pack_tensor
from .sparse_blend import blended_with, goes_with

MODEL_NODE = "Nacre Model"
COVERAGE_NODE = "Nacre Coverage"
FINAL_NODE = "Nacre Final Model"


def material_from_tables(
    tables: AnyTables, name: str, lights: Owner | None = None
) -> bpy.types.Material:
    """A material that evaluates a model's tables, lit by the lights of a scene or collection.

    Raises NacreError when the tables do not fit a texture.
    """
    packed, stand_in = _packed(f"Nacre {name}", tables)
    group = make_model_group(f"Nacre {name}", packed, lights and light_set(lights), stand_in)
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # 4.5 makes the tree on request
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    g = Graph(tree)

    uv = g.node("ShaderNodeUVMap")
    scale = g.node("ShaderNodeVectorMath", g.wire(uv), (1.0, 1.0, 1.0), operation="MULTIPLY")
    scale.name = scale.label = "Repeat"
    frame = g.node("ShaderNodeGroup", node_tree=frame_group())
    model = g.node(
        "ShaderNodeGroup",
        g.wire(scale),
        *(g.wire(frame, number) for number in range(len(frame.outputs))),
        node_tree=group,
    )
    model.name = MODEL_NODE
    emission = g.node("ShaderNodeEmission", g.wire(model))
    output = g.node("ShaderNodeOutputMaterial", g.wire(emission))
    for column, node in enumerate((uv, scale, frame, model, emission, output)):
        node.location, node.hide = (200.0 * column, 0.0), False
    frame.location = (200.0, -250.0)
    _lead_to_cycles(material)
    material.preview_render_type = "SPHERE"
    return material


def set_repeat(material: bpy.types.Material, across: float, up: float) -> None:
    """How many patches a UV unit has along u and v."""
    material.node_tree.nodes["Repeat"].inputs[1].default_value = across, up, 1.0


def set_tables(
    material: bpy.types.Material, tables: AnyTables, environment: EnvironmentTable | None = None
) -> None:
    """Show other tables in place: what is linked to the material's nodes stays, and so does a map
    of coordinates if there are as many texels. `environment` is `environment_for` these tables."""
    group = group_of(material)
    if stored_coordinates(group) is not None and not _same_texels(group, tables):
        set_coordinates(material, None)
    packed, stand_in = _packed(group.name, tables)
    show_tables(group, packed, lights_of(group), stand_in)
    _lead_to_cycles(material)
    _light_by_kept_world(material, group, environment)


def _packed(name: str, tables: AnyTables) -> tuple[Packed, PackedTensor | None]:
    """Tables as images, and those that stand in for them."""
    packed = pack(name, tables)
    if isinstance(tables, Tables) or tables.stand_in is None:
        return packed, None
    return packed, pack_tensor(f"{name} Stand-In", tables.stand_in)


def _same_texels(group: bpy.types.ShaderNodeTree, tables: AnyTables) -> bool:
    shapes = stored(group).shapes
    return (shapes.height, shapes.width) == (tables.height, tables.width)


def _light_by_kept_world(
    material: bpy.types.Material,
    group: bpy.types.ShaderNodeTree,
    environment: EnvironmentTable | None,
) -> None:
    kept = kept_world(material.node_tree)
    if kept is not None:
        show_environment(group, environment, kept.world, kept.mapping)


def set_coverage(
    material: bpy.types.Material, tables: Tables | None, mapping: tuple[float, float] = (0.5, 1.0)
) -> None:
    """Give a material the holes of an occlusion model, by alpha; None for none.

    `mapping` is Eq. 26's threshold and weight, which are inputs of the node as well. EEVEE shows
    partly covered pixels dithered or blended, as the material's own setting says.
    """
    tree = material.node_tree
    before = tree.nodes.get(COVERAGE_NODE)
    if before is not None:
        for mix in [link.to_node for link in before.outputs[0].links]:
            output = mix.outputs[0].links[0].to_node
            shown = mix.inputs[2].links[0].from_socket
            for node in (mix.inputs[1].links[0].from_node, mix):
                tree.nodes.remove(node)
            tree.links.new(shown, output.inputs["Surface"])
        remove_coverage_group(before.node_tree)
        tree.nodes.remove(before)
    if tables is None:
        return
    name = f"Nacre {material.name} Coverage"
    group = make_coverage_group(name, pack(name, tables), mapping)
    model = tree.nodes[MODEL_NODE]
    g = Graph(tree)
    uv, view = (Wire(g, model.inputs[label].links[0].from_socket) for label in ("UV", "View"))
    lay_coverage(group, stored_coordinates(group_of(material)))
    coverage = g.node("ShaderNodeGroup", uv, view, node_tree=group)
    coverage.name = coverage.label = COVERAGE_NODE
    coverage.location, coverage.hide = model.location + Vector((0, 300)), False
    for output in _outputs(tree):
        _cover(g, output, coverage)


def _cover(
    g: Graph, output: bpy.types.ShaderNodeOutputMaterial, coverage: bpy.types.ShaderNodeGroup
) -> None:
    """Lead what an output shows through holes."""
    surface = output.inputs["Surface"]
    hole = g.node("ShaderNodeBsdfTransparent")
    shown = Wire(g, surface.links[0].from_socket)
    mix = g.node("ShaderNodeMixShader", g.wire(coverage), g.wire(hole), shown)
    g.connect(g.wire(mix), surface)
    for node, shift in ((hole, (-400, 200)), (mix, (-300, 50))):
        node.location, node.hide = output.location + Vector(shift), False


def _outputs(tree: bpy.types.ShaderNodeTree) -> list[bpy.types.ShaderNodeOutputMaterial]:
    outputs = [node for node in tree.nodes if node.type == "OUTPUT_MATERIAL"]
    return [node for node in outputs if node.inputs["Surface"].is_linked]


def _lead_to_cycles(material: bpy.types.Material) -> None:
    """Give Cycles an output of its own where it cannot evaluate what EEVEE does."""
    tree = material.node_tree
    if any(output.target == "CYCLES" for output in _outputs(tree)):
        return
    if not needs_osl(material):
        return
    for output in _outputs(tree):  # of all engines: Cycles would unroll its loops, too
        output.target = "EEVEE"
    g = Graph(tree)
    emission = g.node("ShaderNodeEmission", g.wire(tree.nodes[MODEL_NODE], "Cycles"))
    output = g.node("ShaderNodeOutputMaterial", g.wire(emission), target="CYCLES")
    for node, beside in ((emission, "EMISSION"), (output, "OUTPUT_MATERIAL")):
        above = next(own for own in tree.nodes if own.type == beside and own != node)
        node.location, node.hide = above.location + Vector((0, -200)), False
    if tree.nodes.get(COVERAGE_NODE) is not None:
        _cover(g, output, tree.nodes[COVERAGE_NODE])


def set_coordinates(material: bpy.types.Material, coordinates: NDArray[np.integer] | None) -> None:
    """Lay a material by a map of its patch's texels (H, W, 2), row and column, that hides that it
    repeats (tables.coordinate_map); None repeats the patch. A final model with another number of
    texels repeats.
    """
    shown = group_of(material)
    shapes = stored(shown).shapes
    groups = [
        group
        for group in groups_of(material)
        if (stored(group).shapes.height, stored(group).shapes.width)
        == (shapes.height, shapes.width)
    ]
    before = stored_coordinates(shown)
    image = None
    if coordinates is not None:
        image = make_coordinates(f"Nacre {material.name} Coordinates", coordinates)
    for group in groups:
        show_coordinates(group, image)
    coverage = material.node_tree.nodes.get(COVERAGE_NODE)
    if coverage is not None:
        lay_coverage(coverage.node_tree, image)
    if before is not None:
        bpy.data.images.remove(before)


def set_environment(
    material: bpy.types.Material, tables: Sequence[EnvironmentTable], kept: KeptWorld | None
) -> None:
    """Light a material by a world, too: a table for each of `groups_of` it (`environment_for`).
    None for no world. The material keeps the world for tables that are set later."""
    keep_world(material.node_tree, kept)
    for number, group in enumerate(groups_of(material)):
        if kept is None:
            show_environment(group, None, "", "")
        else:
            show_environment(group, tables[number], kept.world, kept.mapping)


def set_final_tables(
    material: bpy.types.Material,
    tables: AnyTables | None,
    environment: EnvironmentTable | None = None,
) -> None:
    """Tables that take the place of others while a final render runs; None for the same ones.

    They wait in a node without links. `environment` is as in set_tables.
    """
    nodes = material.node_tree.nodes
    node = nodes.get(FINAL_NODE)
    if tables is None:
        if node is not None:
            remove_model_group(node.node_tree)
            nodes.remove(node)
        return
    shown = group_of(material)
    if node is not None:
        packed, stand_in = _packed(node.node_tree.name, tables)
        show_tables(node.node_tree, packed, lights_of(node.node_tree), stand_in)
    else:
        name = f"{shown.name} Final"
        packed, stand_in = _packed(name, tables)
        node = nodes.new("ShaderNodeGroup")
        node.node_tree = make_model_group(name, packed, lights_of(shown), stand_in)
        node.name = node.label = FINAL_NODE
        node.location = nodes[MODEL_NODE].location - Vector((0.0, 300.0))
    blended = blended_with(shown)
    if blended is not None and goes_with(stored(node.node_tree), blended):
        blended = pack_sparse(f"{node.node_tree.name} Blended", unpack(blended))
        show_blended(node.node_tree, blended)
    _lead_to_cycles(material)
    laid = stored_coordinates(shown) if _same_texels(shown, tables) else None
    if laid != stored_coordinates(node.node_tree):
        show_coordinates(node.node_tree, laid)
    _light_by_kept_world(material, node.node_tree, environment)


def set_blended(material: bpy.types.Material, tables: SparseTables | None) -> None:
    """Mix a sparse model with a second one, by the input Mix of the material's node; None for none.
    A final model of another method is shown by itself.

    Raises NacreError when their logarithms do not go together.
    """
    for group in groups_of(material):
        if tables is None:
            show_blended(group, None)
            continue
        packed = pack_sparse(f"{group.name} Blended", tables)
        if goes_with(stored(group), packed):
            show_blended(group, packed)
            continue
        for atlas in packed.atlases.values():
            bpy.data.images.remove(atlas.image)
        if group == group_of(material):
            raise NacreError(
                f"{material.name}: only a sparse model of the same offset of the logarithm "
                f"({tables.offset:g}) can be mixed with this one"
            )


def swap_final(material: bpy.types.Material) -> None:
    """Let the waiting tables and the shown ones change places."""
    nodes = material.node_tree.nodes
    final, shown = nodes.get(FINAL_NODE), nodes[MODEL_NODE]
    if final is not None:
        final.node_tree, shown.node_tree = shown.node_tree, final.node_tree


def set_lights(material: bpy.types.Material, owner: Owner, shadows: bool = False) -> None:
    """Light a Nacre material by the lights that a scene or collection has now; in EEVEE with their
    shadows, if wanted."""
    lights = light_set(owner, shadows)
    bring_up_to_date(lights)
    for group in groups_of(material):
        show_lights(group, lights)


def groups_of(material: bpy.types.Material) -> list[bpy.types.ShaderNodeTree]:
    """The node groups of a material's models: the shown one and the final one."""
    nodes = (material.node_tree.nodes.get(name) for name in (MODEL_NODE, FINAL_NODE))
    return [node.node_tree for node in nodes if node is not None]


def nacre_materials() -> list[bpy.types.Material]:
    """All materials in the file that were made here and can be changed."""
    return [item for item in bpy.data.materials if item.is_editable and is_nacre_material(item)]


def group_of(material: bpy.types.Material) -> bpy.types.ShaderNodeTree:
    """The node group that shows a material's model."""
    return material.node_tree.nodes[MODEL_NODE].node_tree


def needs_osl(material: bpy.types.Material) -> bool:
    """Whether Cycles shows a material as it is only with the Open Shading Language."""
    return any(is_sparse(group) for group in groups_of(material))


def is_nacre_material(material: bpy.types.Material | None) -> bool:
    """Whether a material was made here."""
    if material is None or material.node_tree is None:
        return False
    node = material.node_tree.nodes.get(MODEL_NODE)
    return node is not None and is_packed(node.node_tree)
