"""A sparse model's material by the buttons: mixed with another, and what is said of it."""

import bpy
import pytest
from pieces import add_mesh, draw, fails
from small_sparse import model_of

from addon import panels
from addon.models.sparse import as_tensor
from addon.models.sparse.files import save_sparse
from addon.nodes.material import MODEL_NODE, group_of
from addon.nodes.shown import what_is_shown
from addon.nodes.sparse_blend import blended_with

PANEL = panels.active_material.NACRE_PT_active_material


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sparse")
    for seed, name in enumerate(("a", "b")):
        save_sparse(model_of(seed=seed), folder / f"{name}.exr")
    return folder


@pytest.fixture
def material(scene, folder, monkeypatch):
    monkeypatch.setattr(as_tensor, "QUALITY", "DRAFT")  # 4.5 fits each model that it shows
    scene.nacre.model = str(folder / "a.exr")
    item = add_mesh(scene, "A")
    bpy.context.view_layer.objects.active = item
    assert bpy.ops.nacre.create_material() == {"FINISHED"}
    return item.active_material


def test_update_mixes_and_unmixes(material, folder):
    material.nacre.blended = str(folder / "b.exr")
    assert bpy.ops.nacre.update_material() == {"FINISHED"}
    assert blended_with(group_of(material)) is not None
    assert draw(PANEL).count("default_value") == 3  # Repeat X and Y, and Mix
    material.nacre.blended = ""
    assert bpy.ops.nacre.update_material() == {"FINISHED"}
    assert blended_with(group_of(material)) is None
    assert "Mix" not in material.node_tree.nodes[MODEL_NODE].inputs


def test_only_sparse_models_are_mixed(material, model):
    material.nacre.blended = str(model)
    assert "not a sparse model" in fails(bpy.ops.nacre.update_material)


def test_worlds_do_not_light_it(scene, material):
    scene.world = bpy.data.worlds.new("World")
    assert "not lit by worlds" in fails(bpy.ops.nacre.light_by_world)


def test_repetition_is_hidden(material):
    assert bpy.ops.nacre.hide_repetition() == {"FINISHED"}
    assert group_of(material).nodes["Table: Coordinates"].image is not None


def test_what_cycles_lacks_is_said(scene, material):
    scene.render.engine = "CYCLES"
    for device, scripts, word in (
        ("CPU", True, ""),
        ("CPU", False, "Open Shading Language"),
        ("GPU", True, "CPU"),
    ):
        scene.cycles.device, scene.cycles.shading_system = device, scripts
        note = what_is_shown(scene, material)
        assert word in note and bool(word) == bool(note) and "\n" not in note
        assert not note or any(note.startswith(own) for own in draw(PANEL) if len(str(own)) > 9)
    scene.render.engine = "BLENDER_EEVEE" if bpy.app.version >= (5, 0) else "BLENDER_EEVEE_NEXT"
    assert bool(what_is_shown(scene, material)) == (bpy.app.version < (5, 0))
