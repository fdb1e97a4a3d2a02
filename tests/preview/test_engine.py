"""The engine as Blender runs it: F12, models that cannot be read, and panels."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import bpy
import gpu
import numpy as np
import pytest
from small_btf import make_model

import addon
from addon.nodes.material import material_from_tables, set_final_tables, set_tables
from addon.preview import appearance
from addon.preview.appearance import Appearance, appearance_of, final_appearance_of, tables_of
from addon.preview.readings import Readings
from addon.render.engines import render_pixels
from addon.render.stage import add_camera, add_mesh, add_sun, new_scene
from addon.tables.tables import build_tables


@pytest.fixture
def extension() -> Iterator[None]:
    addon.register()
    yield
    addon.unregister()


@pytest.fixture
def scene(extension):
    material = bpy.data.materials.new("Grey")
    material.diffuse_color = (0.5, 0.5, 0.5, 1.0)
    if material.node_tree is not None:
        material.node_tree.nodes.clear()
    with new_scene((16, 12)) as scene:
        add_mesh(scene, "plane", material)
        add_camera(scene, (0.0, 0.0), 2.0)
        add_sun(scene, (0.0, 0.0))
        scene.render.engine = "NACRE"
        yield scene


@pytest.mark.skipif(hasattr(gpu, "init"), reason="5.2 renders in background")
def test_background_of_4_5_says_why_it_cannot(scene):
    with pytest.raises(RuntimeError, match="cannot draw in background before Blender 5.2"):
        render_pixels(scene)


@pytest.mark.usefixtures("need_gpu")
def test_f12(scene):
    pixels = render_pixels(scene)
    assert pixels.shape == (12, 16, 3)
    np.testing.assert_allclose(pixels[6, 8], 0.5 + 0.5 * 0.02, atol=1e-3)
    np.testing.assert_allclose(pixels[0, 0], 0.02, atol=1e-3)


@pytest.mark.usefixtures("need_gpu")
def test_resolution_percentage(scene):
    scene.render.resolution_percentage = 50
    assert render_pixels(scene).shape == (6, 8, 3)


def test_materials_have_the_tables_that_their_nodes_have():
    """Whether the model's file is still there or not, and until the material shows another."""
    models = [make_model((6, 7, 5, 6, 3), (3, rank, 2, 2)) for rank in (2, 5)]
    first, second = (build_tables(model, 16) for model in models)
    material = material_from_tables(first, "Test")
    shown = appearance_of(material)
    np.testing.assert_array_equal(shown.btf.core, first.core)
    assert appearance_of(material).btf is shown.btf
    set_tables(material, second)
    np.testing.assert_array_equal(appearance_of(material).btf.core, second.core)
    set_final_tables(material, first)
    np.testing.assert_array_equal(appearance_of(material).btf.core, second.core)
    np.testing.assert_array_equal(final_appearance_of(material).btf.core, first.core)
    assert shown.occlusion is None


def test_missing_and_broken_models_are_told(tmp_path):
    tables, message = tables_of(str(tmp_path / "none.exr"))
    assert tables is None and "no such model file" in message
    broken = tmp_path / "broken.exr"
    broken.write_bytes(b"not a picture")
    tables, message = tables_of(str(broken))
    assert tables is None and "broken.exr" in message


def test_tables_are_kept_until_the_file_changes(tmp_path, monkeypatch):
    read = []
    monkeypatch.setattr("addon.models.any_model.load_any", lambda path: read.append(path))
    monkeypatch.setattr("addon.tables.any_tables.build_any_tables", lambda model: object())
    appearance.read_tables.cache_clear()
    path = tmp_path / "model.exr"
    path.write_bytes(b"1")
    first, _ = tables_of(str(path))
    assert tables_of(str(path))[0] is first
    path.write_bytes(b"12")
    assert tables_of(str(path))[0] is not first
    assert len(read) == 2
    appearance.read_tables.cache_clear()


def test_models_are_read_on_threads(tmp_path, monkeypatch, extension):
    """A placeholder until they are there, then their tables; a changed file is read anew."""
    go, begun = threading.Event(), []

    def slow(file):
        begun.append(threading.current_thread())
        assert go.wait(10)
        return build_tables(make_model((6, 7, 5, 6, 3), (3, 2, 2, 2)), 16), ""

    monkeypatch.setattr("addon.preview.readings.read_tables", slow)
    path = tmp_path / "model.exr"
    path.write_bytes(b"1")
    material = bpy.data.materials.new("Model")
    material.nacre.model = str(path)
    readings = Readings()
    for _ in range(2):
        shown = appearance_of(material, read=readings.tables_of)
        assert shown.btf is None and "being read" in shown.message
    assert len(begun) == len(readings.running()) == 1
    assert begun[0] is not threading.current_thread()
    go.set()
    begun[0].join(10)
    assert not readings.running()
    shown = appearance_of(material, read=readings.tables_of)
    assert shown.btf is not None and not shown.message
    path.write_bytes(b"12")
    readings.tables_of(str(path))
    assert len(begun) == 2
    assert "no such model file" in readings.tables_of(str(tmp_path / "none.exr"))[1]


def test_what_fails_on_a_thread_is_raised_where_it_is_asked_for(tmp_path, monkeypatch):
    def broken(file):
        raise RuntimeError("a defect")

    monkeypatch.setattr("addon.preview.readings.read_tables", broken)
    path = tmp_path / "model.exr"
    path.write_bytes(b"1")
    readings = Readings()
    with pytest.raises(RuntimeError, match="a defect"):
        for _ in range(100):
            readings.tables_of(str(path))
            time.sleep(0.01)


@pytest.mark.usefixtures("need_gpu")
def test_placeholder_is_a_grey_checker(scene):
    from addon.preview.picture import camera_picture

    scene.view_layers[0].update()
    pixels, messages = camera_picture(
        scene.view_layers[0].depsgraph,
        (16, 12),
        1,
        lambda _material: Appearance(base=(0.4, 0.4, 0.4), message="Grey: gone.exr: no such file"),
    )
    inside = pixels[4:8, 6:10, :3]
    assert messages == ("Grey: gone.exr: no such file",)
    assert inside.std() > 0.05
    np.testing.assert_array_equal(inside[..., 0], inside[..., 1])


def test_standard_panels_show_with_the_engine(extension):
    assert "NACRE" in bpy.types.RENDER_PT_format.COMPAT_ENGINES
    assert "NACRE" in bpy.types.DATA_PT_EEVEE_light.COMPAT_ENGINES


def test_unregistering_takes_panels_back():
    addon.register()
    addon.unregister()
    panels = bpy.types.Panel.__subclasses__()
    assert not any("NACRE" in getattr(panel, "COMPAT_ENGINES", ()) for panel in panels)
