"""Panels draw in every state, from what is known already, and name only what exists."""

import builtins
from types import SimpleNamespace

import bpy
import pytest
from pieces import Layout, draw, region

from addon import jobs, panels
from addon.panels import layout as pieces


def by_name(name):
    return next(cls for cls in panels.CLASSES if cls.__name__ == name)


def test_an_empty_scene_shows_the_steps():
    shown = {cls.__name__: draw(cls) for cls in panels.CLASSES}
    assert "nacre.import_btf" in shown["NACRE_PT_import_btf"]
    assert "nacre.measure" in shown["NACRE_PT_measure"]
    assert "nacre.compress" in shown["NACRE_PT_compress"]
    assert "nacre.create_material" in shown["NACRE_PT_create_material"]
    assert shown["NACRE_PT_compare_with_cycles"] == ["nacre.compare_with_cycles"]
    assert shown["NACRE_PT_missing_wheels"] is None
    assert shown["NACRE_PT_active_material"] is None


def test_a_comparison_shows_its_wipe_and_its_figures(scene):
    scene.nacre.comparison.facts = "PSNR\t31.0 dB"
    for name in ("NACRE_PT_compare_with_cycles", "NACRE_PT_compare_in_images"):
        assert draw(by_name(name)) == ["nacre.compare_with_cycles", "wipe", "PSNR", "31.0 dB"]


def test_panels_are_in_the_nacre_tab():
    for cls in panels.CLASSES:
        assert (cls.bl_region_type, cls.bl_category) == ("UI", "Nacre")
    elsewhere = {cls.__name__ for cls in panels.CLASSES if cls.bl_space_type != "VIEW_3D"}
    assert elsewhere == {"NACRE_PT_compare_in_images"}


def test_facts_are_drawn_without_reading_a_file(scene, dataset, model, monkeypatch):
    scene.nacre.dataset, scene.nacre.model = str(dataset), str(model)
    bpy.ops.mesh.primitive_plane_add()
    assert bpy.ops.nacre.create_material() == {"FINISHED"}
    with monkeypatch.context() as without_files:
        without_files.setattr(builtins, "open", None)
        without_files.setattr("os.stat", None)
        dataset_shown, model_shown, shown = (
            draw(by_name(f"NACRE_PT_{name}"))
            for name in ("import_btf", "create_material", "active_material")
        )
    assert "81 lights × 81 views" in dataset_shown
    assert any("dB" in text for text in model_shown)
    assert shown[:4] == ["wool", "lights", "shadows", "default_value"]
    assert {"model", "occlusion", "final_model", "nacre.update_material"} <= set(shown)


def test_only_a_target_asks_for_a_number(scene):
    for quality, name in (("MEDIUM", None), ("TARGET_DB", "target_db"), ("TARGET_MB", "target_mb")):
        scene.nacre.quality = quality
        shown = draw(by_name("NACRE_PT_compress"))
        assert [item for item in shown if str(item).startswith("target")] == (
            [name] if name else []
        )


def test_measuring_asks_for_what_it_needs(scene, tmp_path):
    chosen, panel = scene.nacre.measurement, by_name("NACRE_PT_measure")
    assert {"views", "lights", "samples", "bounces"} <= set(draw(panel))
    assert "81 lights × 81 views" in draw(panel)
    chosen.views, chosen.lights, chosen.use_noise_target = "uniform", "csv", True
    assert {"view_count", "light_file", "noise_db"} <= set(draw(panel))
    chosen.kind = "MASK"
    assert not {"lights", "samples", "noise_db"} & set(draw(panel))
    chosen.kind, chosen.output = "BTF", str(tmp_path / "a.nacre")
    for number in range(3):
        (tmp_path / ".a.nacre.measuring").mkdir(exist_ok=True)
        (tmp_path / ".a.nacre.measuring" / f"{number:05}.npz").touch()
    assert draw(panel).count("nacre.measure") == 2
    assert "Measured already: 3 of the lights" in draw(panel)


def test_a_problem_takes_as_many_lines_as_it_needs(scene, tmp_path):
    scene.nacre.dataset = str(tmp_path)
    shown = draw(by_name("NACRE_PT_import_btf"))
    text = " ".join(shown[2:])
    assert "is not a Nacre dataset" in text
    assert max(map(len, shown)) < 45


def test_progress_takes_the_place_of_the_button(monkeypatch):
    job = jobs.Job(lambda progress: None, "nacre.compress")
    job._progress(0.25, "Reading")
    monkeypatch.setattr(jobs, "running", lambda: job)
    shown = draw(by_name("NACRE_PT_compress"))
    assert shown[-3:] == [("progress", 0.25, "25%"), "nacre.cancel", "Reading"]
    assert "nacre.import_btf" in draw(by_name("NACRE_PT_import_btf"))


def test_what_is_missing_takes_the_place_of_the_steps(monkeypatch):
    monkeypatch.setattr(pieces.wheels, "missing", lambda: "The package x is missing")
    shown = {cls.__name__: draw(cls) for cls in panels.CLASSES}
    assert shown.pop("NACRE_PT_missing_wheels") == ["The package x is missing"]
    assert set(shown.values()) == {None}


@pytest.mark.parametrize("width", [60, 200, 4000])
def test_any_width_will_do(width):
    seen = []
    context = SimpleNamespace(**region(width))
    pieces.draw_text(context, Layout(seen), "a few words " * 10, icon="ERROR")
    assert " ".join(seen) == ("a few words " * 10).strip()
