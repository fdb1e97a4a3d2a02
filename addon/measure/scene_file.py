"""What a saved scene holds that can be measured."""

from __future__ import annotations

import hashlib
from pathlib import Path

import bpy

from ..errors import NacreError
from .patch import SHAPES

Item = bpy.types.Object | bpy.types.Collection | bpy.types.Material


def open_scene(path: Path) -> str:
    """Load a .blend, and what tells this state of the file from others.

    Scripts in the file do not run. Raises NacreError when it cannot be loaded.
    """
    if not path.is_file():
        raise NacreError(f"there is no scene {path}")
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    try:
        bpy.ops.wm.open_mainfile(filepath=str(path.resolve()), load_ui=False, use_scripts=False)
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[0].removeprefix("Error: ")
        raise NacreError(f"{path.name} cannot be opened as a .blend: {reason}") from error
    return f"{path.name} {digest[:16]}"


def find_item(kind: str | None, name: str | None) -> Item:
    """The object, collection or material of a name, or the only one that there is to measure.

    `kind` is "object", "collection", "material" or None, for a collection of the scene, else an
    object, else a material, if there is just one. Raises NacreError when it is not there or when
    there are several.
    """
    scene = bpy.context.scene
    found: dict[str, list[Item]] = {
        "collection": [item for item in scene.collection.children if item.all_objects],
        "object": [item for item in scene.objects if item.type in SHAPES],
        "material": list(bpy.data.materials),
    }
    if kind is not None:
        known = getattr(bpy.data, f"{kind}s")
        if name in known:
            return known[name]
        names = ", ".join(item.name for item in found[kind]) or "none"
        raise NacreError(f"the scene has no {kind} {name!r}; it has: {names}")
    for items in found.values():
        if len(items) == 1:
            return items[0]
        if items:
            break
    names = "; ".join(
        f"--{key} {item.name!r}" for key, items in found.items() for item in items[:4]
    )
    raise NacreError(f"say what to measure: {names or 'the scene has nothing that renders'}")
