"""The extension registered in Blender as a module, and one measured file on its way through."""

import shutil
import sys
from pathlib import Path

import bpy
import pytest

import addon

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / name) for name in ("datasets", "models", "ui")]  # the test writers

SAMPLE = Path(__file__).resolve().parents[2] / "samples" / "wool_W64xH64_L81xV81.btf"


@pytest.fixture(scope="session", autouse=True)
def registered():
    addon.register()
    yield
    addon.unregister()


@pytest.fixture(autouse=True)
def scene():
    """An empty file's scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene


@pytest.fixture
def sample(tmp_path):
    """A copy of the sample in a folder of its own."""
    return Path(shutil.copy(SAMPLE, tmp_path / "wool.btf"))


@pytest.fixture(scope="session")
def dataset(tmp_path_factory):
    """The sample, imported."""
    path = tmp_path_factory.mktemp("dataset") / "wool.nacre"
    assert bpy.ops.nacre.import_btf(filepath=str(SAMPLE), destination=str(path)) == {"FINISHED"}
    return path


@pytest.fixture(scope="session")
def model(dataset, tmp_path_factory):
    """The sample, compressed at draft quality."""
    path = tmp_path_factory.mktemp("model") / "wool.exr"
    settings = bpy.context.scene.nacre
    settings.dataset, settings.quality, settings.output = str(dataset), "DRAFT", str(path)
    assert bpy.ops.nacre.compress() == {"FINISHED"}
    return path
