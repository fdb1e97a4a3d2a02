"""What keeps materials in step with the file they are in: handlers of Blender's own events.

Lights that move are followed by drivers (nodes.light_group); what is here is for lights that come
and go, and for final renders of another quality.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.app.handlers import persistent

from . import wheels
from .nodes.light_set import (
    Owner,
    bring_up_to_date,
    has_shadows,
    light_set,
    light_set_named,
    light_sets,
    owner_of,
)
from .quality_slider import follow_qualities

# Modules that need the compiled packages are imported where there is something to show: the
# extension must come up without them, to say so.

_KINDS = ("OBJECT", "LIGHT", "COLLECTION", "SCENE")


def follow_lights(scene: bpy.types.Scene) -> bool:
    """Bring all light sets, and the materials under them, up to date; whether anything changed.

    Materials whose lights have gone, as those that came from another file, are lit by `scene`.
    """
    sets = light_sets()
    if wheels.missing() is not None:
        return False
    from .nodes.material import groups_of, nacre_materials
    from .nodes.model_group import lights_of, parted_from, show_lights

    groups = [group for material in nacre_materials() for group in groups_of(material)]
    parted = [group for group in groups if parted_from(group)]
    if not sets and not parted:
        return False
    changed = [tree for tree in sets if owner_of(tree) is not None and bring_up_to_date(tree)]
    stray = [tree for tree in sets if tree != _own(tree, owner_of(tree))]
    if not changed and not stray and not parted:
        return False
    for group in groups:
        lights = lights_of(group)
        if group in parted:
            show_lights(group, light_set_named(parted_from(group), scene))
        elif lights in stray:
            show_lights(group, _own(lights, owner_of(lights) or scene))
        elif lights in changed:
            show_lights(group, lights)
    for tree in stray:
        bpy.data.node_groups.remove(tree)
    return True


def part_from_lights() -> None:
    """Take every pointer away that handlers may have made since the last step of undo.

    What two steps hold alike, Blender leaves in memory as it is: pointers to what the other step
    does not have, and nodes that no longer fit each other, would end in a crash.
    """
    sets = light_sets()
    if not sets or wheels.missing() is not None:
        return
    from .nodes import model_group
    from .nodes.material import groups_of, nacre_materials

    for material in nacre_materials():
        for group in groups_of(material):
            model_group.part_from_lights(group)
    for tree in sets:
        tree.animation_data_clear()


def _own(tree: bpy.types.ShaderNodeTree, owner: Owner | None) -> bpy.types.ShaderNodeTree | None:
    """The light set of its kind that an owner has."""
    return None if owner is None else light_set(owner, has_shadows(tree))


def materials_showing(path: str | Path) -> list[bpy.types.Material]:
    """The materials that show a model's file."""
    from .nodes.material import nacre_materials

    wanted = Path(path).resolve()
    return [
        material
        for material in nacre_materials()
        if material.nacre.model and Path(bpy.path.abspath(material.nacre.model)).resolve() == wanted
    ]


def follow_worlds() -> None:
    """Let materials follow worlds that were turned by hand; keys are followed by drivers."""
    if wheels.missing() is not None:
        return
    from .nodes.material import groups_of, nacre_materials
    from .nodes.model_group import follow_turned_world

    for material in nacre_materials():
        for group in groups_of(material):
            follow_turned_world(group)


def follow_files() -> None:
    """Write what scripts of sparse models read in Cycles where this session has not yet."""
    if wheels.missing() is not None:
        return
    from .nodes.material import groups_of, nacre_materials
    from .nodes.model_group import follow_scripts

    for material in nacre_materials():
        for group in groups_of(material):
            follow_scripts(group)


@persistent
def _updated(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if any(depsgraph.id_type_updated(kind) for kind in _KINDS):
        _changed(scene)
    if depsgraph.id_type_updated("WORLD") or depsgraph.id_type_updated("NODETREE"):
        follow_worlds()


@persistent
def _changed(scene: bpy.types.Scene | str | None, *_: Any) -> None:
    # While a picture is rendered on a thread, the trees it reads must not be written.
    if not bpy.app.is_job_running("RENDER"):
        follow_lights(scene if isinstance(scene, bpy.types.Scene) else bpy.context.scene)


@persistent
def _read(*_: Any) -> None:
    follow_files()


@persistent
def _reverted(scene: bpy.types.Scene | str | None, *_: Any) -> None:
    _changed(scene)
    follow_qualities()


@persistent
def _part(*_: Any) -> None:
    part_from_lights()


@persistent
def _swap(*_: Any) -> None:
    if wheels.missing() is not None:
        return
    from .nodes.material import nacre_materials, swap_final

    for material in nacre_materials():
        swap_final(material)


_HANDLERS = (
    ("depsgraph_update_post", _updated),
    ("load_post", _reverted),
    ("load_post", _read),
    ("blend_import_post", _read),
    ("undo_pre", _part),
    ("redo_pre", _part),
    ("undo_post", _reverted),
    ("redo_post", _reverted),
    ("render_init", _swap),
    ("render_complete", _swap),
    ("render_cancel", _swap),
)


def register() -> None:
    """Listen to Blender's events."""
    for name, handler in _HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    """Listen no more."""
    for name, handler in _HANDLERS:
        getattr(bpy.app.handlers, name).remove(handler)
