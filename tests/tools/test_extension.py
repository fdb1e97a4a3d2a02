"""The staged extension is what Blender's own tool accepts."""

import tomllib
import zipfile
from pathlib import Path

import pytest

from tools import extension, extension_wheels
from tools.native_wheel import ROOT


@pytest.fixture
def checkout(tmp_path):
    """A small checkout with the real manifest and licence."""
    root = tmp_path / "with space"
    (root / "addon" / "nodes" / "__pycache__").mkdir(parents=True)
    (root / "addon" / "__init__.py").write_text("def register(): ...\ndef unregister(): ...\n")
    (root / "addon" / "nodes" / "__init__.py").write_text("")
    (root / "addon" / "nodes" / "__pycache__" / "x.pyc").write_text("")
    (root / "shaders").mkdir()
    (root / "shaders" / "decode.glsl").write_text("void main() {}\n")
    for name in ("blender_manifest.toml", "LICENSE"):
        (root / name).write_bytes((ROOT / name).read_bytes())
    return root


def test_built_archive_holds_package_shaders_and_wheels(checkout, capfd):
    folder, archive = checkout / "build" / "stage", checkout / "dist" / "nacre.zip"
    extension.stage(checkout, folder)
    names = ["nacre_native-0.1.0-cp313-cp313-manylinux_2_28_x86_64.whl"]
    (folder / "wheels").mkdir()
    (folder / "wheels" / names[0]).write_bytes(b"wheel")
    extension.list_wheels(folder / "blender_manifest.toml", names)
    extension.build(folder, archive)
    with zipfile.ZipFile(archive) as opened:
        assert set(opened.namelist()) == {
            "LICENSE",
            "__init__.py",
            "blender_manifest.toml",
            "nodes/__init__.py",
            "shaders/decode.glsl",
            f"wheels/{names[0]}",
        }
        manifest = tomllib.loads(opened.read("blender_manifest.toml").decode())
    assert manifest["wheels"] == [f"./wheels/{names[0]}"]
    assert "error" not in capfd.readouterr().out.lower()


def test_refused_extension_stops_the_build(checkout, capfd):
    folder = checkout / "stage"
    extension.stage(checkout, folder)
    (folder / "__init__.py").unlink()
    with pytest.raises(SystemExit, match="refused"):
        extension.build(folder, checkout / "dist" / "nacre.zip")
    assert "Not a Python package" in capfd.readouterr().out


def test_staging_leaves_nothing_of_the_last_time(checkout):
    extension.stage(checkout, checkout / "stage")
    (checkout / "stage" / "old.py").write_text("")
    extension.stage(checkout, checkout / "stage")
    assert not (checkout / "stage" / "old.py").exists()


def test_manifest_is_valid_toml_with_an_empty_wheel_list():
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text())
    assert manifest["wheels"] == []
    assert manifest["blender_version_min"] == "4.5.0"


def test_wheel_names():
    wheel = Path("openexr-3.5.3-cp313-cp313-manylinux_2_28_x86_64.whl")
    assert extension_wheels.python_tag(wheel) == "cp313"


@pytest.mark.parametrize("name", extension_wheels.INDEX_PACKAGES)
def test_both_blenders_are_tested_with_the_bundled_version(name):
    version = extension_wheels.pinned_version(name)
    text = (ROOT / "requirements" / "blender-4.5.txt").read_text()
    assert f"\n{name}=={version}\n" in text


def test_wheel_built_elsewhere_is_taken(tmp_path, monkeypatch):
    monkeypatch.setattr(extension_wheels.pythons, "usable", lambda version: None)
    wheel = tmp_path / "nacre_native-0.1.0-cp314-cp314-linux_x86_64.whl"
    wheel.write_bytes(b"")
    assert extension_wheels.helper_wheels(tmp_path) == {"cp314": wheel}
    assert extension_wheels.helper_wheels(None) == {}
