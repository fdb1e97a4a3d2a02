"""The user's scene in EEVEE and in Cycles, beside each other."""

import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.errors import Cancelled, NacreError
from addon.operators import compare_with_cycles
from addon.render.comparison import IMAGES, WIPE, differences, draw_wipe, scene_pixels
from addon.second_blender import save_copy

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def lit(scene):
    """A bright half and a dark half, which both engines see alike but for their glow."""
    for name, x, strength in (("Bright", -1.0, 0.8), ("Dark", 1.0, 0.2)):
        material = bpy.data.materials.new(name)
        if material.node_tree is None:  # before 5.0
            material.use_nodes = True
        tree = material.node_tree
        tree.nodes.clear()
        emission, output = (
            tree.nodes.new(f"ShaderNode{kind}") for kind in ("Emission", "OutputMaterial")
        )
        emission.inputs["Strength"].default_value = strength
        tree.links.new(emission.outputs[0], output.inputs[0])
        bpy.ops.mesh.primitive_plane_add(size=2.0, location=(x, 0.0, 0.0))
        bpy.context.object.data.materials.append(material)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", 4.0, (0.0, 0.0, 5.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.resolution_x, scene.render.resolution_y = 16, 8
    scene.cycles.samples, scene.eevee.taa_render_samples = 4, 1
    scene.cycles.use_denoising = False
    return scene


def pixels(name: str) -> np.ndarray:
    image = bpy.data.images[name]
    found = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(found)
    return found.reshape(image.size[1], image.size[0], 4)


def brighten_eevee(scene):
    """Something that only one of the engines shows."""
    tree = bpy.data.materials["Dark"].node_tree
    tree.nodes["Material Output"].target = "CYCLES"
    other = tree.nodes.new("ShaderNodeOutputMaterial")
    other.target = "EEVEE"
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Strength"].default_value = 0.5
    tree.links.new(emission.outputs[0], other.inputs[0])


def test_both_pictures_their_difference_and_a_wipe(lit):
    brighten_eevee(lit)
    assert bpy.ops.nacre.compare_with_cycles() == {"FINISHED"}
    eevee, cycles = pixels(IMAGES["eevee"]), pixels(IMAGES["cycles"])
    assert eevee.shape == (8, 16, 4)
    row = np.repeat([0.8, 0.5], 8)
    assert eevee[4, 1:-1, 0] == pytest.approx(row[1:-1], abs=0.15)
    assert eevee[4, 12] == pytest.approx((0.5, 0.5, 0.5, 1.0), abs=0.01)
    assert cycles[4, 12] == pytest.approx((0.2, 0.2, 0.2, 1.0), abs=0.01)
    assert pixels(IMAGES["difference"])[4, 12, :3] == pytest.approx(0.3, abs=0.01)
    assert pixels(IMAGES["difference"])[4, 3, :3] == pytest.approx(0.0, abs=0.01)

    chosen = lit.nacre.comparison
    psnr, mean = (line.split("\t")[1] for line in chosen.facts.splitlines())
    assert psnr.endswith(" dB") and float(psnr.split()[0]) == pytest.approx(11.5, abs=0.8)
    assert float(mean.split()[0]) == pytest.approx(0.16, abs=0.02)
    for wipe, expected in ((1.0, eevee), (0.0, cycles)):
        chosen.wipe = wipe
        assert np.array_equal(pixels(WIPE), expected)
    chosen.wipe = 0.75
    assert np.array_equal(pixels(WIPE)[:, :12], eevee[:, :12])
    assert np.array_equal(pixels(WIPE)[:, 12:], cycles[:, 12:])


def test_the_scene_is_left_as_it_was(lit):
    lit.render.engine = "CYCLES"
    lit.render.filepath = "//mine_####"
    lit.render.image_settings.file_format = "PNG"
    lit.render.image_settings.color_mode = "BW"
    lit.render.image_settings.color_depth = "16"
    lit.view_settings.view_transform = "AgX"
    lit.view_settings.look = "AgX - Punchy"
    lit.render.use_compositing = True

    def state():
        image = lit.render.image_settings
        owners = {"render": lit.render, "image": image, "view": lit.view_settings,
                  "cycles": lit.cycles, "eevee": lit.eevee}  # fmt: skip
        return {
            (name, p.identifier): getattr(owner, p.identifier)
            for name, owner in owners.items()
            for p in owner.bl_rna.properties
            if p.type in ("INT", "FLOAT", "BOOLEAN", "ENUM", "STRING") and not p.is_readonly
            and not getattr(p, "is_array", False)
        }  # fmt: skip

    before, objects = state(), set(bpy.data.objects)
    assert bpy.ops.nacre.compare_with_cycles() == {"FINISHED"}
    assert state() == before
    assert set(bpy.data.objects) == objects and len(bpy.data.scenes) == 1


def test_again_at_another_size_in_the_same_images(lit):
    assert bpy.ops.nacre.compare_with_cycles() == {"FINISHED"}
    images = set(bpy.data.images)
    lit.render.resolution_x = 24
    assert bpy.ops.nacre.compare_with_cycles() == {"FINISHED"}
    assert set(bpy.data.images) == images
    assert all(
        tuple(image.size) == (24, 8) for image in images if image.name in (WIPE, *IMAGES.values())
    )


def test_undo_keeps_the_pictures(lit):
    assert bpy.ops.nacre.compare_with_cycles() == {"FINISHED"}
    before = pixels(IMAGES["cycles"])
    bpy.ops.ed.undo_push(message="compared")
    bpy.data.objects.remove(bpy.data.objects["Plane"])
    bpy.ops.ed.undo_push(message="removed")
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert "Plane" in bpy.data.objects
    assert np.allclose(pixels(IMAGES["cycles"]), before, atol=1e-3)
    bpy.context.scene.nacre.comparison.wipe = 0.0
    assert np.array_equal(pixels(WIPE), pixels(IMAGES["cycles"]))


def test_without_a_camera(lit):
    lit.camera = None
    with pytest.raises(RuntimeError, match="Add a camera: what it sees is compared"):
        bpy.ops.nacre.compare_with_cycles()


def test_another_blender_renders_a_copy(lit, tmp_path, monkeypatch):
    """As from the window; `python -m addon` stands for `blender --command nacre`."""
    monkeypatch.setattr(
        compare_with_cycles, "nacre_command", lambda *rest: [sys.executable, "-m", "addon", *rest]
    )
    monkeypatch.chdir(ROOT)
    file = save_copy(str(tmp_path))
    said = []
    found = compare_with_cycles._render_there(
        file, "cycles", lambda *given: said.append(given) or True
    )
    assert np.array_equal(found, scene_pixels(lit, "cycles"))
    assert said[0] == (0.5, "Rendering with Cycles")
    with pytest.raises(Cancelled):
        compare_with_cycles._render_there(file, "eevee", lambda *given: False)
    lit.camera = None
    with pytest.raises(NacreError, match="the scene has no camera: add one"):
        compare_with_cycles._render_there(save_copy(str(tmp_path)), "cycles", lambda *given: True)


def test_a_wipe_before_any_picture(scene):
    assert draw_wipe(0.5) is None
    scene.nacre.comparison.wipe = 0.25
    assert WIPE not in bpy.data.images


def test_differences():
    first, second = np.full((2, 2, 3), 0.5, np.float32), np.full((2, 2, 3), 0.4, np.float32)
    found = differences(first, second)
    assert found["mean_abs"] == pytest.approx(0.1)
    assert found["relative"] == pytest.approx(0.25)
    assert found["psnr_db"] == pytest.approx(20 * np.log10(4.0), abs=1e-4)
    assert differences(first, first)["psnr_db"] == float("inf")
