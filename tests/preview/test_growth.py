"""Undo, redo and loading a file leave nothing behind, however often: in the file, among Blender's
handlers, and on the graphics card."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import bpy
import gpu
import pytest
from small_btf import make_model

import addon
from addon.nodes.light_set import light_set
from addon.nodes.material import group_of, material_from_tables, nacre_materials, set_tables
from addon.nodes.model_group import lights_of
from addon.preview.appearance import appearance_of
from addon.preview.context import need_gpu
from addon.preview.draw import Resources, prepare, table_bytes
from addon.tables.tables import Tables, build_tables

CYCLES = (12, pytest.param(50, marks=pytest.mark.acceptance))
SETTLED = 2  # cycles until what is made once has been made


@pytest.fixture
def registered() -> Iterator[None]:
    addon.register()
    yield
    addon.unregister()


@pytest.fixture
def qualities() -> tuple[Tables, Tables]:
    """Tables of two qualities of one material."""
    views = {"clusters": {"view": 3}, "mixtures": {"view": 2}}
    return tuple(
        build_tables(make_model((6, 7, 8, 8, 3), ranks, **views), 16)
        for ranks in ((4, 4, 3, 3), (6, 4, 3, 3))
    )


@pytest.fixture
def material(registered, qualities) -> str:
    """The name of a material that shows the first of them on a plane, lit by the scene's sun."""
    bpy.ops.mesh.primitive_plane_add()
    plane = bpy.context.object
    bpy.ops.object.light_add(type="SUN")
    shown = material_from_tables(qualities[0], "Shown", bpy.context.scene)
    plane.active_material = shown
    return shown.name


def counts() -> dict[str, int]:
    """How many of everything there are."""
    found = {
        name: len(getattr(bpy.data, name))
        for name in dir(bpy.data)
        if isinstance(getattr(bpy.data, name), bpy.types.bpy_prop_collection)
    }
    for name in dir(bpy.app.handlers):
        handlers = getattr(bpy.app.handlers, name)
        if isinstance(handlers, list):
            found[f"handlers {name}"] = len(handlers)
    return found


def drawn(resources: Resources) -> dict[str, int]:
    """What a viewport of the engine keeps on the graphics card once it has drawn the scene."""
    if not hasattr(gpu, "init"):  # Blender 4.5 has no GPU in background
        return {}
    need_gpu()
    prepare(bpy.context.evaluated_depsgraph_get(), resources, appearance_of)
    return {
        "meshes": len(resources.meshes),
        "textures": len(resources.textures),
        "bytes": table_bytes(resources),
        "shaders": len(resources.shaders),
    }


@pytest.mark.parametrize("cycles", CYCLES)
def test_undo_and_redo_again_and_again(material, qualities, cycles):
    resources, seen = Resources(), []
    bpy.ops.ed.undo_push(message="Begin")
    for number in range(cycles):
        # Another quality, another light and another mesh.
        set_tables(bpy.data.materials[material], qualities[1 - number % 2])
        bpy.ops.object.light_add("EXEC_DEFAULT", False, type="POINT")
        bpy.ops.mesh.primitive_cube_add("EXEC_DEFAULT", False)
        bpy.context.object.active_material = bpy.data.materials[material]
        bpy.ops.ed.undo_push(message="Change")
        changed = counts()
        assert bpy.ops.ed.undo() == {"FINISHED"}
        undone = counts()
        assert len(bpy.data.lights) == 1
        assert bpy.ops.ed.redo() == {"FINISHED"}
        assert len(bpy.data.lights) == 2
        assert counts() == changed != undone
        shown = drawn(resources)
        bpy.ops.ed.undo()
        seen.append((changed, undone, shown, counts() | drawn(resources)))
    assert all(cycle == seen[SETTLED] for cycle in seen[SETTLED:])


@pytest.mark.parametrize("cycles", CYCLES)
def test_loading_the_file_again_and_again(material, tmp_path, cycles):
    path = str(tmp_path / "shown.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    seen = []
    for _ in range(cycles):
        bpy.ops.wm.open_mainfile(filepath=path)
        assert [shown.name for shown in nacre_materials()] == [material]
        bpy.context.view_layer.update()
        resources = Resources()
        found = counts() | drawn(resources)
        del resources
        gc.collect()
        found["kept"] = sum(isinstance(thing, Resources) for thing in gc.get_objects())
        seen.append(found)
    assert seen[SETTLED]["images"] > 0
    assert all(found == seen[SETTLED] for found in seen[SETTLED:])


@pytest.mark.usefixtures("need_gpu")
def test_a_mesh_that_is_gone_leaves_the_card(material):
    resources = Resources()
    bpy.ops.mesh.primitive_cube_add()
    assert drawn(resources)["meshes"] == 2
    bpy.data.objects.remove(bpy.context.object)
    assert drawn(resources)["meshes"] == 1


def test_nothing_that_handlers_made_is_pointed_at_while_undo_runs(material):
    """Blender leaves in memory what two steps hold alike, whatever handlers did to it since: in the
    window, a second undo left a group that had been written for a light that was gone."""
    shown = group_of(bpy.data.materials[material])
    lights = lights_of(shown)
    during = []

    def look(*_) -> None:
        during.append((lights_of(group_of(bpy.data.materials[material])), drivers(lights)))

    def drivers(tree: bpy.types.NodeTree) -> int:
        return len(tree.animation_data.drivers) if tree.animation_data else 0

    written = len(shown.nodes), drivers(lights)
    assert written[1] > 0
    bpy.ops.ed.undo_push(message="One")
    bpy.ops.ed.undo_push(message="The same")
    for handlers in (bpy.app.handlers.undo_pre, bpy.app.handlers.redo_pre):
        handlers.append(look)
    for step in (bpy.ops.ed.undo, bpy.ops.ed.redo):
        assert step() == {"FINISHED"}
        shown = group_of(bpy.data.materials[material])
        assert lights_of(shown) == light_set(bpy.context.scene)
        assert (len(shown.nodes), drivers(lights_of(shown))) == written
        lights = lights_of(shown)
    for handlers in (bpy.app.handlers.undo_pre, bpy.app.handlers.redo_pre):
        handlers.remove(look)
    assert during == [(None, 0), (None, 0)]
