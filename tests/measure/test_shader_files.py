"""Shaders are found in the checkout and in the staged extension."""

import importlib.util

import pytest

from addon.shader_files import shader_text
from tools import extension
from tools.native_wheel import ROOT


def test_staged_extension_finds_its_shaders(tmp_path):
    extension.stage(ROOT, tmp_path / "stage")
    path = tmp_path / "stage" / "shader_files.py"
    spec = importlib.util.spec_from_file_location("staged", path)
    staged = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(staged)
    text = staged.shader_text("hemisphere_camera.osl")
    assert text == shader_text("hemisphere_camera.osl")
    assert "shader hemisphere_camera" in text


def test_missing_shader():
    with pytest.raises(FileNotFoundError, match="not part of this installation"):
        shader_text("no.osl")
