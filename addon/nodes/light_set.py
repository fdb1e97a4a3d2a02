"""The lights of a scene or of a collection as one node group that materials share.

    Nacre Lights OWNER            -> Direction 1, Radiance 1, Direction 2, ...
    Nacre Lights OWNER Shadowed   the same, where EEVEE dims each light as it reaches the point

Drivers keep each light in step (light_group); `bring_up_to_date` follows lights that come and go.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy

from .graph import Graph, Wire
from .light_group import KINDS, drive_light, light_group, samples_of
from .visibility_group import drive_visibility, visibility_group

_OWNER = "nacre_lights_of"  # a name, since a pointer would bring the scene along into other files
_SHADOWS = "nacre_shadows"
_SHADOWED = "shadowed/"
_LIGHT = "Light"
_OUTPUTS = ("Direction", "Radiance", "Distance")

Owner = bpy.types.Scene | bpy.types.Collection


def light_set(owner: Owner, shadows: bool = False) -> bpy.types.ShaderNodeTree:
    """The group of a scene's or collection's lights, made at first use; with the shadows that EEVEE
    sees, or without (visibility_group)."""
    for tree in light_sets():
        if tree[_OWNER] == _key(owner) and has_shadows(tree) == shadows:
            return tree
    name = f"Nacre Lights {owner.name}{' Shadowed' if shadows else ''}"
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    tree[_OWNER], tree[_SHADOWS] = _key(owner), shadows
    _write(tree, shining(owner))
    return tree


def has_shadows(tree: bpy.types.ShaderNodeTree) -> bool:
    """Whether a group's radiances have shadows in EEVEE."""
    return bool(tree.get(_SHADOWS))


def light_sets() -> list[bpy.types.ShaderNodeTree]:
    """All groups of lights that belong to this file."""
    return [tree for tree in bpy.data.node_groups if tree.library is None and _OWNER in tree]


def forget(owner: Owner) -> None:
    """Remove the group of an owner that is about to go."""
    for tree in light_sets():
        if tree[_OWNER] == _key(owner):
            bpy.data.node_groups.remove(tree)


def owner_of(tree: bpy.types.ShaderNodeTree) -> Owner | None:
    """Whose lights a group has; None when that is gone or has another name."""
    return _owner_named(tree[_OWNER])


def key_of(tree: bpy.types.ShaderNodeTree) -> str:
    """What names a group of lights, for `light_set_named`."""
    return f"{_SHADOWED if has_shadows(tree) else ''}{tree[_OWNER]}"


def light_set_named(key: str, otherwise: Owner) -> bpy.types.ShaderNodeTree:
    """The group of this key, with the lights of another owner when its own is not there."""
    owner = _owner_named(key.removeprefix(_SHADOWED))
    return light_set(owner or otherwise, key.startswith(_SHADOWED))


def _owner_named(name: str) -> Owner | None:
    kind, name = name.split("/", 1)
    return getattr(bpy.data, kind).get(name)


def shining(owner: Owner) -> list[bpy.types.Object]:
    """The lights that can be followed and are visible: to the render in the background, else in the
    window."""
    items = owner.objects if isinstance(owner, bpy.types.Scene) else owner.all_objects
    return [item for item in items if _is_light(item) and _is_visible(item)]


def bring_up_to_date(tree: bpy.types.ShaderNodeTree) -> bool:
    """Follow lights that were added, removed, shown, hidden or became of another kind; whether
    there was anything to do."""
    owner = owner_of(tree)
    lights = shining(owner) if owner else []
    if _followed(tree) == _sampled(lights):
        return False
    _write(tree, lights)
    return True


def count_of(tree: bpy.types.ShaderNodeTree) -> int:
    """How many directions a group has; an area light has several."""
    return len(tree.interface.items_tree) // 2


def _key(owner: Owner) -> str:
    return f"{'scenes' if isinstance(owner, bpy.types.Scene) else 'collections'}/{owner.name}"


def _is_light(item: bpy.types.Object) -> bool:
    return item.type == "LIGHT" and item.data.type in KINDS


def _is_visible(item: bpy.types.Object) -> bool:
    return not item.hide_render if bpy.app.background else item.visible_get()


def _sampled(lights: Sequence[bpy.types.Object]) -> list[bpy.types.Object]:
    return [light for light in lights for _ in samples_of(light)]


def _followed(tree: bpy.types.ShaderNodeTree) -> list[bpy.types.Object | None]:
    """What the drivers of each node look at, in the order of the nodes."""
    curves = tree.animation_data.drivers if tree.animation_data else ()
    kinds = {
        curve.data_path: curve.driver.variables[0].targets[0].id
        for curve in curves
        if curve.data_path.endswith("inputs[0].default_value")
    }
    nodes = [node for node in tree.nodes if node.name.startswith(_LIGHT)]
    return [kinds.get(f'nodes["{node.name}"].inputs[0].default_value') for node in nodes]


def _write(tree: bpy.types.ShaderNodeTree, lights: Sequence[bpy.types.Object]) -> None:
    tree.animation_data_clear()
    tree.nodes.clear()
    tree.interface.clear()
    g = Graph(tree)
    outputs: list[Wire] = []
    for light in lights:
        found = []
        for sample in samples_of(light):
            node = g.node("ShaderNodeGroup", node_tree=light_group())
            node.name, node.label = _LIGHT, light.name
            drive_light(node, light, sample)
            found.append([g.wire(node, label) for label in _OUTPUTS])
        directions, radiances, distances = zip(*found, strict=True)
        if has_shadows(tree):
            visible = _visibility(g, light, directions, radiances, distances[0])
            radiances = [radiance * visible for radiance in radiances]
        for direction, radiance in zip(directions, radiances, strict=True):
            outputs += [direction, radiance]
    for number in range(1, len(outputs) // 2 + 1):
        for label, kind in (("Direction", "Vector"), ("Radiance", "Color")):
            tree.interface.new_socket(
                f"{label} {number}", in_out="OUTPUT", socket_type=f"NodeSocket{kind}"
            )
    g.node("NodeGroupOutput", *outputs)


def _visibility(
    g: Graph,
    light: bpy.types.Object,
    directions: Sequence[Wire],
    radiances: Sequence[Wire],
    distance: Wire,
) -> Wire:
    """How much of a light arrives: asked once, for the middle of its samples."""
    middle, total = directions[0], radiances[0]
    for direction, radiance in zip(directions[1:], radiances[1:], strict=True):
        middle, total = middle + direction, total + radiance
    if len(directions) > 1:
        middle = g.normalize(middle)
    node = g.node("ShaderNodeGroup", middle, total, distance, node_tree=visibility_group())
    node.label = f"{light.name} Visibility"
    drive_visibility(node, light)
    return g.wire(node)
