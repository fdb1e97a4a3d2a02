"""The right Python is found among those that are there, whatever stands in front of them."""

import sys
from pathlib import Path

import pytest

from tools import pythons

VERSION = f"{sys.version_info.major}.{sys.version_info.minor}"


def script(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("#!/bin/sh\n" + text)
    path.chmod(0o755)
    return path


@pytest.fixture
def bare(tmp_path, monkeypatch):
    """A machine with nothing but an empty folder on the path."""
    (tmp_path / "bin").mkdir()
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path / "pyenv"))
    for version in ("311", "313", "314"):
        monkeypatch.delenv("PY" + version, raising=False)
    return tmp_path


def fake(path: Path, version: str, lacks: str = "") -> Path:
    """A Python that answers the probe as told."""
    return script(path, f"printf '%s\\n' '{version}' '{path}' '{lacks}'\n")


def test_this_python_is_complete():
    found = pythons.probe(sys.executable)
    assert found == pythons.Interpreter(Path(sys.executable), VERSION)


def test_shim_of_an_absent_version_is_no_python(bare):
    shim = script(bare / "bin" / "python9.13", "echo 'command not found' >&2; exit 127\n")
    assert pythons.probe(str(shim)) is None
    real = fake(bare / "pyenv/versions/9.13.2/bin/python9.13", "9.13")
    assert pythons.usable("9.13") == real


def test_newest_patch_release_wins(bare):
    fake(bare / "pyenv/versions/9.13.9/bin/python9.13", "9.13")
    newest = fake(bare / "pyenv/versions/9.13.10/bin/python9.13", "9.13")
    assert pythons.usable("9.13") == newest


def test_path_comes_before_pyenv(bare):
    fake(bare / "pyenv/versions/9.13.9/bin/python9.13", "9.13")
    first = fake(bare / "bin/python9.13", "9.13")
    assert pythons.usable("9.13") == first


@pytest.mark.parametrize("lacks", ["venv", "Python.h", "venv Python.h", "GIL"])
def test_incomplete_python_is_passed_over(bare, lacks):
    fake(bare / "bin/python9.13", "9.13", lacks)
    assert pythons.usable("9.13") is None
    complete = fake(bare / "pyenv/versions/9.13.1/bin/python9.13", "9.13")
    assert pythons.usable("9.13") == complete


def test_wrong_version_is_passed_over(bare):
    fake(bare / "bin/python9.13", "9.12")
    assert pythons.usable("9.13") is None


def test_uv_is_asked(bare):
    python = fake(bare / "elsewhere/python9.13", "9.13")
    script(bare / "bin/uv", f'[ "$*" = "python find 9.13" ] && echo {python}\n')
    assert pythons.usable("9.13") == python


def test_a_variable_names_the_python(bare, monkeypatch):
    fake(bare / "bin/python3.14", "3.14")
    chosen = fake(bare / "elsewhere/python", "3.14")
    monkeypatch.setenv("PY314", str(chosen))
    assert pythons.usable("3.14") == chosen


def test_absence_names_debian_packages(bare):
    script(bare / "bin/apt-cache", '[ "$2" = python9.11-venv ]\n')
    fake(bare / "bin/python9.11", "9.11", "venv Python.h")
    fault = pythons.absence(["9.13", "9.11"])
    assert fault.packages == ("python9.11", "python9.11-venv", "python9.11-dev")
    assert f"{bare}/bin/python9.11 lacks venv and Python.h" in fault.what


def test_absence_without_packages_names_uv_and_pyenv(bare):
    fault = pythons.absence(["9.13", "9.11"])
    assert fault.packages == ()
    assert "uv python install 9.13" in fault.what
    assert "pyenv install 9.13" in fault.what
