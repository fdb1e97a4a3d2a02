"""The user's scene is the same after a measurement, however it ended."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from addon.datasets.direction_sets import direction_set
from addon.errors import Cancelled, NacreError
from addon.measure.btf import measure_btf
from addon.measure.occlusion import measure_occlusion
from addon.measure.patch import open_patch
from addon.measure.settings import Settings

LIGHT = direction_set("uniform:3")
# Collections of everything that a file may hold.
KINDS = [
    p.identifier
    for p in bpy.types.BlendData.bl_rna.properties
    if p.type == "COLLECTION" and p.identifier != "all_ids"
]  # fmt: skip
# Blender's own: the scratch picture of all renders, and what says when something was looked at.
SKIPPED = {"rna_type", "depsgraph", "is_evaluated", "original", "id_data", "session_uid", "users"}


@pytest.fixture
def scene():
    """An ordinary scene of an ordinary user, with a monkey to measure."""
    bpy.ops.wm.read_homefile(use_empty=False, use_factory_startup=True)
    bpy.ops.mesh.primitive_monkey_add(size=2, location=(3, 1, 2))
    scene = bpy.context.scene
    material = bpy.data.materials["Material"]  # the cube's
    material.node_tree.nodes["Principled BSDF"].inputs["Subsurface Weight"].default_value = 0.5
    scene.frame_set(7)
    scene.render.resolution_x, scene.cycles.samples = 123, 77
    scene.render.filepath = "//mine.png"
    return scene


def _state() -> dict[str, str]:
    """Every property of every block of data, of the window's scene and of the selection."""
    state = {}
    for kind in KINDS:
        for item in getattr(bpy.data, kind):
            if kind == "images" and item.name in ("Render Result", "Viewer Node"):
                continue
            state |= _properties(f"{kind}/{item.name}", item, 2)
    context = bpy.context
    state["scene"] = context.scene.name
    state["window"] = str([window.scene.name for window in context.window_manager.windows])
    state["active"] = str(context.view_layer.objects.active)
    state["selected"] = str(sorted(item.name for item in context.view_layer.objects.selected))
    return state


def _properties(path: str, item: bpy.types.bpy_struct, depth: int) -> dict[str, str]:
    found = {}
    for prop in item.bl_rna.properties:
        if prop.identifier in SKIPPED:
            continue
        value = getattr(item, prop.identifier, None)
        name = f"{path}.{prop.identifier}"
        if prop.type == "POINTER":
            own = value is not None and not isinstance(value, bpy.types.ID)
            if own and depth:
                found |= _properties(name, value, depth - 1)
            elif not own:
                found[name] = repr(value)
        elif prop.type == "COLLECTION":
            found[name] = str([getattr(entry, "name", "") for entry in value][:100])
        elif getattr(prop, "is_array", False):
            found[name] = str(np.array(value).tolist())
        else:
            found[name] = repr(value)
    return found


def _measure(path, **options):
    with open_patch(bpy.data.objects["Suzanne"]) as patch:
        return measure_btf(patch, path, LIGHT, LIGHT, Settings(8, 1), **options)


def _cancelled(path):
    with pytest.raises(Cancelled):
        _measure(path, progress=lambda fraction, _: fraction < 0.5)


def _failed(path):
    below = np.array([[1.0, 0.0, 0.0]])
    with (
        pytest.raises(NacreError, match="below the horizon"),
        open_patch(bpy.data.objects["Suzanne"]) as patch,
    ):
        measure_btf(patch, path, below, LIGHT, Settings(8, 1))


def _occlusion(path):
    with open_patch(bpy.data.objects["Suzanne"]) as patch:
        measure_occlusion(patch, path, LIGHT, width=8)


def _not_empty(path):
    path.mkdir()
    (path / "precious.txt").write_text("mine")
    with pytest.raises(NacreError, match="is not a Nacre dataset"):
        _measure(path)


def _translucent(path):
    with open_patch(bpy.data.objects["Cube"]) as patch:
        measure_btf(patch, path, LIGHT, LIGHT, Settings(8, 1))


def _material(path):
    with open_patch(bpy.data.materials["Material"], (1, 1)) as patch:
        measure_btf(patch, path, LIGHT, LIGHT, Settings(8, 1))


WAYS = [_measure, _cancelled, _failed, _occlusion, _not_empty, _translucent, _material]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize(
    "way", [_measure, _cancelled, _failed, _occlusion, _not_empty, _translucent, _material]
)
def test_scene_is_left_as_it_was(tmp_path, scene, way):
    before = _state()
    assert len(before) > 2000
    way(tmp_path / "a.nacre")
    after = _state()
    assert {key: (before.get(key), after.get(key)) for key in before | after
            if before.get(key) != after.get(key)} == {}  # fmt: skip
