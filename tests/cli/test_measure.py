"""`measure` and `merge`: from a .blend to a dataset, in parts, and what can be wrong with it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon.cli import main  # noqa: E402
from addon.datasets.dataset import open_dataset  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
SMALL = ["--texels", "4", "--samples", "2", "--lights", "uniform:3", "--views", "uniform:4"]


@pytest.fixture(scope="module")
def scenes(tmp_path_factory) -> Path:
    """A scene with one object and one with a collection of two."""
    folder = tmp_path_factory.mktemp("scenes")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_plane_add(size=0.5)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "plane.blend"))
    bpy.ops.mesh.primitive_cube_add(size=0.1)
    collection = bpy.data.collections.new("Pair")
    for item in list(bpy.context.scene.collection.objects):
        collection.objects.link(item)
        bpy.context.scene.collection.objects.unlink(item)
    bpy.context.scene.collection.children.link(collection)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "pair.blend"))
    collection.objects.unlink(bpy.data.objects["Cube"])
    bpy.context.scene.collection.objects.link(bpy.data.objects["Cube"])
    bpy.context.scene.collection.children.unlink(collection)
    bpy.context.scene.collection.objects.link(bpy.data.objects["Plane"])
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "two.blend"))
    (folder / "bad.blend").write_bytes(b"not a blend")
    return folder


def test_the_only_object_is_measured(nacre, scenes, tmp_path):
    nacre("measure", str(scenes / "plane.blend"), str(tmp_path / "a.nacre"), *SMALL)
    found = json.loads(nacre("info", str(tmp_path / "a.nacre"), "--json").splitlines()[-1])
    assert (found["light"], found["view"], found["width"], found["height"]) == (3, 4, 4, 4)
    assert found["patch_size"] == [0.5, 0.5]
    assert found["side_channels"] == ["albedo", "normal", "height"]
    assert found["source"]["measurement"]["samples"] == 2
    assert found["source"]["measurement"]["origin"].startswith("plane.blend ")


def test_parts_on_a_farm(nacre, scenes, tmp_path):
    """A frame a light: frame numbers are the parts."""
    options = [*SMALL, "--size", "0.5", "--collection", "Pair"]
    scene = str(scenes / "pair.blend")
    nacre("measure", scene, str(tmp_path / "whole.nacre"), *options)
    parts = [str(tmp_path / f"{frame}.nacre") for frame in (1, 2, 3)]
    for frame, part in enumerate(parts, 1):
        nacre("measure", scene, part, *options, "--part", f"{frame}/3")
        assert open_dataset(part).shape[0] == 1
    nacre("merge", *reversed(parts), str(tmp_path / "merged.nacre"))
    for file in sorted((tmp_path / "whole.nacre").iterdir()):
        assert file.read_bytes() == (tmp_path / "merged.nacre" / file.name).read_bytes(), file.name


def test_occlusion(nacre, scenes, tmp_path):
    nacre(
        "measure", str(scenes / "two.blend"), str(tmp_path / "a.nacre"), "--kind", "occlusion",
        "--object", "Cube", "--size", "0.2", "--texels", "4", "--views", "uniform:3",
    )  # fmt: skip
    dataset = open_dataset(tmp_path / "a.nacre")
    assert (dataset.kind, dataset.shape) == ("occlusion", (3, 4, 4))
    expected = np.zeros((4, 4))
    expected[1:3, 1:3] = 1
    np.testing.assert_array_equal(dataset.samples[0], expected)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("absent.blend a.nacre", ["there is no scene", "absent.blend"]),
        ("bad.blend a.nacre", ["bad.blend", "cannot be opened"]),
        ("two.blend a.nacre", ["say what to measure", "--object 'Plane'", "--object 'Cube'"]),
        ("two.blend a.nacre --object Ball", ["no object 'Ball'", "Cube, Plane"]),
        ("two.blend a.nacre --material Red", ["no material 'Red'", "none"]),
        ("pair.blend a.nacre", ["Pair", "give the size"]),
        ("plane.blend a.nacre --size 0", ["'0'", "0.02"]),
        ("plane.blend a.nacre --size 1,2,3", ["'1,2,3'"]),
        ("plane.blend a.nacre --part 3/2", ["'3/2'", "2/5"]),
        ("plane.blend a.nacre --views ubo", ["'ubo'", "ubo81"]),
        ("plane.blend a.nacre --lights none.csv", ["none.csv"]),
        ("plane.blend a.nacre --kind occlusion --samples 3", ["--samples", "occlusion"]),
        ("plane.blend a.nacre --value mask", ["--value", "btf"]),
        ("plane.blend a.nacre --noise 99", ["99 dB"]),
        ("plane.blend absent/a.nacre", ["absent"]),
        ("plane.blend plane.blend", ["plane.blend", "is not a Nacre dataset"]),
    ],
)
def test_mistakes(scenes, monkeypatch, capfd, arguments, words):
    monkeypatch.chdir(scenes)
    before = sorted(path.name for path in scenes.iterdir())
    assert main(["measure", *arguments.split()]) == 2
    said = capfd.readouterr().err  # to which Blender adds when a scene cannot be opened
    assert said.count("\nnacre: ") <= 1 and said.splitlines()[-1].startswith("nacre: ")
    for word in words:
        assert word in said
    assert sorted(path.name for path in scenes.iterdir()) == before


def test_no_scripts_of_the_scene_run(nacre, scenes, tmp_path):
    """A .blend from elsewhere may bring a text block that asks to be run."""
    bpy.ops.wm.open_mainfile(filepath=str(scenes / "plane.blend"))
    text = bpy.data.texts.new("evil.py")
    text.write(f"open({str(tmp_path / 'ran')!r}, 'w')")
    text.use_module = True
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "evil.blend"))
    code = "import sys; from addon.cli import main; sys.exit(main(sys.argv[1:]))"
    subprocess.run(
        [sys.executable, "-c", code, "measure", str(tmp_path / "evil.blend"),
         str(tmp_path / "a.nacre"), *SMALL],
        check=True, capture_output=True, cwd=ROOT,
    )  # fmt: skip
    assert (tmp_path / "a.nacre").is_dir() and not (tmp_path / "ran").exists()


def test_compressing_beyond_the_noise_is_said_to_be_pointless(nacre, scenes, tmp_path):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_monkey_add(size=1)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "monkey.blend"))
    path, model = str(tmp_path / "a.nacre"), str(tmp_path / "a.exr")
    nacre("measure", str(tmp_path / "monkey.blend"), path, *SMALL)
    floor = open_dataset(path).noise_floor_db
    assert floor is not None and 0 < floor < 40
    every = "light=9,view=4,y=2,x=4"
    said = nacre("compress", path, model, "--method", "nsvd", "--ranks", every)
    assert f"beyond the samples' noise floor of {floor:.1f} dB" in said
    assert "noise floor" not in nacre(
        "compress", path, model, "--method", "nsvd", "--ranks", "light=1,view=1,y=1,x=1"
    )
