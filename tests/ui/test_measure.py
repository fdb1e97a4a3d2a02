"""The panel's measurement, as scripts and `blender -b` run it."""

import argparse
import sys
from pathlib import Path

import bpy
import pytest

from addon.datasets.dataset import open_dataset
from addon.errors import Cancelled, NacreError
from addon.measure import request as request_module
from addon.measure import scene_file
from addon.measure.request import Request
from addon.measure.settings import Settings
from addon.measure.unfinished import count_finished
from addon.operators.measure import _measure_there, request
from addon.panels.measure import expected_dataset
from addon.verbs import VERBS

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def chosen(scene):
    bpy.ops.mesh.primitive_plane_add(size=0.5)
    found = scene.nacre.measurement
    found.texels, found.samples = 4, 1
    found.views = found.lights = "uniform"
    found.view_count, found.light_count = 3, 2
    return found


def fails(**options) -> str:
    with pytest.raises(RuntimeError) as caught:
        bpy.ops.nacre.measure(**options)
    text = str(caught.value).strip()
    assert text.startswith("Error: ") and "\n" not in text
    return text.removeprefix("Error: ")


def test_the_active_object_becomes_the_scene_s_dataset(tmp_path, scene, chosen):
    chosen.output = str(tmp_path / "plane")
    assert bpy.ops.nacre.measure() == {"FINISHED"}
    assert scene.nacre.dataset == str(tmp_path / "plane.nacre")
    dataset = open_dataset(tmp_path / "plane.nacre")
    assert dataset.shape == (2, 3, 4, 4, 3) and dataset.patch_size == (0.5, 0.5)
    assert ("Directions\t2 lights × 3 views") in scene.nacre.dataset_facts
    assert expected_dataset(chosen) == (
        "Directions\t2 lights × 3 views\nTexels\t4 × 4\nSize\t1 kB"
    )  # fmt: skip


@pytest.mark.parametrize("what", ["collection", "material"])
def test_a_collection_or_a_material(tmp_path, chosen, what):
    chosen.what = what.upper()
    with pytest.raises(RuntimeError, match=f"Choose the {what} to measure"):
        bpy.ops.nacre.measure()
    setattr(chosen, what, getattr(bpy.data, f"{what}s").new("Mine"))
    if what == "collection":
        chosen.collection.objects.link(bpy.context.object)
    chosen.output = str(tmp_path / "a.nacre")
    assert "give the size" in fails()
    chosen.width = 0.25
    assert bpy.ops.nacre.measure() == {"FINISHED"}
    assert open_dataset(tmp_path / "a.nacre").patch_size == (0.25, 0.25)


@pytest.mark.parametrize(("kind", "value"), [("MASK", "mask"), ("DISTANCE", "signed-distance")])
def test_occlusion(tmp_path, chosen, kind, value):
    chosen.kind, chosen.output = kind, str(tmp_path / "a.nacre")
    assert bpy.ops.nacre.measure() == {"FINISHED"}
    dataset = open_dataset(tmp_path / "a.nacre")
    assert (dataset.kind, dataset.value, dataset.shape) == ("occlusion", value, (3, 4, 4))


def test_mistakes_in_one_line(tmp_path, chosen):
    assert "save the .blend file first" in fails()
    chosen.output = str(tmp_path / "a.nacre")
    chosen.views, chosen.view_file = "csv", str(tmp_path / "none.csv")
    assert "none.csv" in fails()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "asked",
    [
        Request(),
        Request("occlusion", "signed-distance", (0.1, 0.2), "uniform:7"),
        Request(size=(0.012, 0.024), settings=Settings(32, noise_db=28.5, bounces=7, seed=3)),
        Request(views="a.csv", lights="ubo151", settings=Settings(8, 2), part=(2, 5), resume=True),
        Request(restart=True),
    ],
)
def test_the_second_blender_is_asked_for_the_same(tmp_path, monkeypatch, asked):
    """The arguments that a request gives are parsed back to it."""
    seen = []

    def measure(item, path, request, **options):
        seen.append(request)
        raise KeyboardInterrupt

    (tmp_path / "a.csv").write_text("theta,phi\n0,0\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(request_module, "measure", measure)
    monkeypatch.setattr(scene_file, "open_scene", lambda path: "")
    monkeypatch.setattr(scene_file, "find_item", lambda kind, name: None)
    parser = argparse.ArgumentParser()
    VERBS["measure"].add_arguments(parser)
    with pytest.raises(KeyboardInterrupt):
        options = parser.parse_args(["a.blend", "a.nacre", *asked.arguments()])
        VERBS["measure"].run(options, lambda fraction, message: True)
    assert seen == [asked]


def test_choices_become_a_request(chosen):
    chosen.width, chosen.height = 0.5, 0.25
    chosen.use_noise_target, chosen.noise_db = True, 20.0
    assert request(chosen, restart=True) == Request(
        size=(0.5, 0.25), views="uniform:3", lights="uniform:2",
        settings=Settings(4, 1, noise_db=20.0), restart=True,
    )  # fmt: skip


# Python with bpy stands for the second Blender: the same command line, started another way.
SECOND = "import sys; sys.path.insert(0, sys.argv.pop(1)); from addon.cli import main; " \
    "sys.exit(main(sys.argv[1:]))"  # fmt: skip


def test_another_process_is_followed_cancelled_and_gone_on_with(tmp_path, chosen):
    scene, output = tmp_path / "a.blend", tmp_path / "a.nacre"
    bpy.ops.wm.save_as_mainfile(filepath=str(scene), copy=True)
    asked = Request(
        views="uniform:4", lights="uniform:8", settings=Settings(32, 64), resume=True
    ).arguments()
    command = [sys.executable, "-c", SECOND, str(ROOT), "measure", str(scene), str(output), *asked]
    with pytest.raises(Cancelled):
        _measure_there(command, output, 8, lambda fraction, _: fraction == 0)
    before = count_finished(output)
    assert 1 <= before < 8 and not output.exists()
    seen = []
    dataset = _measure_there(
        command, output, 8, lambda fraction, text: seen.append((fraction, text)) or True
    )
    assert dataset.shape[0] == 8 and seen[0] == (0, "Preparing")
    with pytest.raises(NacreError, match="has no object 'Absent'; it has: Plane"):
        _measure_there([*command, "--object=Absent"], output, 8, lambda fraction, _: True)
