"""The slider of a sparse model: other qualities in place, on a thread, also while it is dragged."""

import shutil
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from pieces import add_mesh, draw, fails
from small_btf import make_model, write_dataset

from addon import live, panels, quality_slider
from addon.models.any_model import load_any
from addon.models.exr import save_model
from addon.models.sparse.coding import code
from addon.models.sparse.files import save_ensemble, save_sparse
from addon.models.sparse.training import train
from addon.nodes import node_tables
from addon.nodes.material import FINAL_NODE, group_of, groups_of
from addon.nodes.packed_tables import stored, unpack
from addon.nodes.sparse_blend import blended_with
from addon.tables.any_tables import build_any_tables

SHAPE = (6, 7, 16, 20, 3)
BEST = 100


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A dataset a.nacre, an ensemble e.exr and a model m.exr, mostly of coefficients."""
    folder = tmp_path_factory.mktemp("slider")
    dataset = write_dataset(folder / "a.nacre", SHAPE)
    sparsity = {"Y": 60, "U": 12, "V": 12}
    ensemble = train([dataset], patch=(4, 4), dictionaries=2, sweeps=2, sparsity=sparsity)
    save_ensemble(ensemble, folder / "e.exr")
    model = code(dataset, ensemble, BEST)
    save_sparse(model, folder / "m.exr")
    return folder


@pytest.fixture(autouse=True)
def quick_stand_in(monkeypatch):
    """What Blender 4.5 shows instead is a fit, which other tests look at."""
    monkeypatch.setattr(node_tables, "fit_tensor", lambda model, progress=None: make_model(SHAPE))


@pytest.fixture
def path(folder, tmp_path):
    return shutil.copy(folder / "m.exr", tmp_path / "m.exr")


@pytest.fixture
def material(scene, path):
    scene.nacre.model = str(path)
    item = add_mesh(scene, "A")
    bpy.context.view_layer.objects.active = item
    assert bpy.ops.nacre.create_material() == {"FINISHED"}
    return item.active_material


def counts(tables):
    """The coefficients in tables, of each part."""
    return {key: len(part.coefficients) for key, part in tables.parts.items()}


def shown(group):
    return counts(unpack(stored(group)))


def expected(path, quality):
    return counts(build_any_tables(load_any(path).truncated(quality)))


def test_a_new_material_has_the_files_quality(scene, material, path):
    settings = material.nacre
    assert (settings.quality, settings.file_quality, settings.shown_quality) == (BEST,) * 3
    assert shown(group_of(material)) == expected(path, BEST)
    assert f"Method\tSparseBTF({BEST})" in scene.nacre.model_facts
    assert "quality" in draw(panels.active_material.NACRE_PT_active_material)


def test_the_slider_shows_another_quality_in_place(material, path):
    group, images = group_of(material), len(bpy.data.images)
    links = len(material.node_tree.links)
    for quality in (8, 20, 1, BEST):
        material.nacre.quality = quality
        assert material.nacre.shown_quality == quality
        assert shown(group) == expected(path, quality)
        tables = unpack(stored(group))
        wanted = build_any_tables(load_any(path).truncated(quality))
        for key, part in wanted.parts.items():
            np.testing.assert_allclose(
                tables.parts[key].coefficients[..., 0], part.coefficients[..., 0], rtol=1e-3
            )
    assert group_of(material) == group and len(material.node_tree.links) == links
    assert len(bpy.data.images) == images


def test_the_slider_ends_at_the_files_quality(material, path):
    material.nacre.quality = 999
    assert material.nacre.quality == BEST
    assert shown(group_of(material)) == expected(path, BEST)


def test_final_renders_have_a_quality_of_their_own(material, path):
    material.nacre.quality = 4
    material.nacre.final_quality = 32
    group, final = groups_of(material)
    assert shown(group) == expected(path, 4) and shown(final) == expected(path, 32)
    assert bpy.ops.nacre.update_material() == {"FINISHED"}
    assert [shown(one) for one in groups_of(material)] == [expected(path, q) for q in (4, 32)]
    material.nacre.final_quality = 0
    assert groups_of(material) == [group]
    material.nacre.final_model = str(path)
    assert bpy.ops.nacre.update_material() == {"FINISHED"}
    assert shown(material.node_tree.nodes[FINAL_NODE].node_tree) == expected(path, BEST)
    assert "final_quality" not in draw(panels.active_material.NACRE_PT_active_material)


def test_what_is_mixed_with_it_has_the_same_quality(material, path, tmp_path):
    other = load_any(path)
    turned = {key: replace(own, values=-own.values) for key, own in other.codes.items()}
    save_sparse(replace(other, codes=turned), tmp_path / "other.exr")
    material.nacre.quality = 4
    material.nacre.blended = str(tmp_path / "other.exr")
    assert bpy.ops.nacre.update_material() == {"FINISHED"}
    for quality in (4, 16):
        material.nacre.quality = quality
        group = group_of(material)
        assert shown(group) == expected(path, quality)
        assert counts(unpack(blended_with(group))) == expected(path, quality)
    material.nacre.final_quality = 32
    final = groups_of(material)[1]
    assert shown(final) == expected(path, 32) and blended_with(final) is not None
    material.nacre.blended = ""
    assert bpy.ops.nacre.update_material() == {"FINISHED"}
    material.nacre.quality = 8
    assert blended_with(group_of(material)) is None


def test_a_model_of_tensors_has_no_slider(material, tmp_path):
    material.nacre.quality = 8
    save_model(make_model(SHAPE), tmp_path / "tensor.exr")
    material.nacre.model = str(tmp_path / "tensor.exr")
    assert bpy.ops.nacre.update_material() == {"FINISHED"}
    assert material.nacre.file_quality == 0
    assert "quality" not in draw(panels.active_material.NACRE_PT_active_material)
    assert not hasattr(unpack(stored(group_of(material))), "parts")
    material.nacre.quality = 16  # by a script: nothing comes of it
    assert not hasattr(unpack(stored(group_of(material))), "parts")


def test_a_file_that_was_cut_short_says_so(scene, path):
    data = path.read_bytes()
    path.write_bytes(data[: int(0.9 * len(data))])
    least = load_any(path).quality
    scene.nacre.model = str(path)
    item = add_mesh(scene, "A")
    bpy.context.view_layer.objects.active = item
    assert bpy.ops.nacre.create_material() == {"FINISHED"}
    settings = item.active_material.nacre
    assert settings.quality == settings.shown_quality == settings.file_quality == least < BEST
    assert f"ends at quality {least}" in settings.problem
    assert any(
        "cut short" in str(text) for text in draw(panels.active_material.NACRE_PT_active_material)
    )


def test_a_file_that_is_gone_is_named(material, path):
    path.unlink()
    material.nacre.quality = 8
    assert "m.exr: cannot be read" in material.nacre.problem
    assert material.nacre.shown_quality == BEST
    problem = draw(panels.active_material.NACRE_PT_active_material)
    assert any("cannot" in str(text) for text in problem)


# In the window ------------------------------------------------------------------------------------


class Timers(list):
    def register(self, function, first_interval=0.0):
        self.append(function)

    def fire(self):
        """One look of each."""
        for function in list(self):
            if function() is None:
                self.remove(function)


@pytest.fixture
def timers(monkeypatch):
    """As with a window, whose timers fire when a test says so."""
    timers, rendering = Timers(), []
    app = SimpleNamespace(
        background=False, timers=timers, is_job_running=lambda kind: bool(rendering)
    )
    timers.rendering = rendering
    known = SimpleNamespace(app=app, data=bpy.data, path=bpy.path)
    monkeypatch.setattr(quality_slider, "bpy", known)
    return timers


def finish(timers):
    end = time.monotonic() + 10
    while timers:
        timers.fire()
        assert time.monotonic() < end
        time.sleep(0.005)


def test_a_low_quality_is_there_first_and_better_ones_follow(scene, timers, path):
    scene.nacre.model = str(path)
    assert bpy.ops.nacre.create_material() == {"FINISHED"}
    material = bpy.data.materials["m"]
    first = shown(group_of(material))
    assert first["Y"] < expected(path, BEST)["Y"]
    assert material.nacre.quality == BEST > material.nacre.shown_quality
    finish(timers)
    assert shown(group_of(material)) == expected(path, BEST)
    assert material.nacre.shown_quality == BEST


def test_dragging_builds_the_last_value_and_few_others(material, path, timers, monkeypatch):
    built = []
    gate = threading.Event()
    coming = quality_slider._coming

    def slow(wanted):
        gate.wait(10)
        built.append(wanted.quality)
        yield from coming(wanted)

    monkeypatch.setattr(quality_slider, "_coming", slow)
    for quality in range(BEST - 1, 7, -1):
        material.nacre.quality = quality
        timers.fire()
    assert len(timers) == 1
    gate.set()
    finish(timers)
    assert material.nacre.shown_quality == 8
    assert shown(group_of(material)) == expected(path, 8)
    assert built == [BEST - 1, 8]


def test_nothing_is_written_while_a_picture_is_rendered(material, path, timers):
    timers.rendering.append(True)
    material.nacre.quality = 8
    for _ in range(100):
        timers.fire()
        time.sleep(0.002)
    assert timers and shown(group_of(material)) == expected(path, BEST)
    timers.rendering.clear()
    finish(timers)
    assert shown(group_of(material)) == expected(path, 8)


def test_a_material_that_is_removed_ends_it(material, timers):
    material.nacre.quality = 8
    bpy.data.materials.remove(material)
    finish(timers)


def test_stopped_threads_show_nothing(material, path, timers):
    material.nacre.quality = 8
    quality_slider.stop()
    finish(timers)
    assert shown(group_of(material)) == expected(path, BEST)


def test_undone_sliders_are_followed(material, path, monkeypatch):
    """A step of undo may have been taken between a slider's move and its tables."""
    with monkeypatch.context() as patch:
        patch.setattr(quality_slider, "follow_quality", lambda material: None)
        material.nacre.quality = 8
    assert material.nacre.shown_quality == BEST
    live._reverted(bpy.context.scene)
    assert shown(group_of(material)) == expected(path, 8)


# Compress -----------------------------------------------------------------------------------------


def test_compressing_sparse_codes(scene, folder, tmp_path):
    settings = scene.nacre
    settings.dataset, settings.method = str(folder / "a.nacre"), "SPARSE"
    settings.output = str(tmp_path / "a.exr")
    assert "Nacre's ubo81: it is for 81" in settings.ensemble_facts
    assert "train one" in fails(bpy.ops.nacre.compress)
    settings.ensemble, settings.sparse_quality = str(folder / "e.exr"), 16
    facts = dict(row.split("\t") for row in settings.ensemble_facts.split("\n"))
    assert facts["Dictionaries"] == "2 for Y, 2 for U, 2 for V" and facts["Patches"] == "4 × 4"
    seen = draw(panels.compress.NACRE_PT_compress)
    assert "ensemble" in seen and "sparse_quality" in seen and "quality" not in seen
    assert bpy.ops.nacre.compress() == {"FINISHED"}
    assert load_any(tmp_path / "a.exr").quality == 16
    assert "Method\tSparseBTF(16)" in settings.model_facts
    settings.method = "KCTA"
    assert "ensemble" not in draw(panels.compress.NACRE_PT_compress)
    assert settings.ensemble_facts == "" and settings.expected_size


def test_dictionaries_that_do_not_fit_are_named_before_and_after(scene, folder, tmp_path):
    settings = scene.nacre
    other = write_dataset(tmp_path / "b.nacre", (6, 8, 8, 10, 3))
    settings.dataset, settings.method = str(other.path), "SPARSE"
    settings.ensemble = str(folder / "e.exr")
    assert settings.ensemble_facts.startswith("\t") and "7 views" in settings.ensemble_facts
    assert "7 views" in fails(bpy.ops.nacre.compress)
    settings.ensemble = str(tmp_path / "absent.exr")
    assert "no such file" in settings.ensemble_facts


def test_a_model_compressed_again_is_shown_in_place(scene, material, path, folder):
    material.nacre.quality = 4
    settings = scene.nacre
    settings.dataset, settings.method = str(folder / "a.nacre"), "SPARSE"
    settings.output, settings.ensemble = str(path), str(folder / "e.exr")
    settings.sparse_quality = 24
    assert bpy.ops.nacre.compress() == {"FINISHED"}
    assert (material.nacre.file_quality, material.nacre.quality) == (24, 24)
    assert shown(group_of(material)) == expected(path, 24)
