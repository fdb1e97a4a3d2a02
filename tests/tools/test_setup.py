"""Which environments are made from which Pythons, and when one counts as ready."""

import json
import sys

import pytest

from tools import native_wheel, setup


def folders(root, *versions):
    """Folder name and version of each environment planned where these Pythons are."""
    found = setup.environments(root, lambda version: version in versions)
    return [(environment.folder.name, environment.version) for environment in found]


def test_main_environment_has_the_newest_python(tmp_path):
    assert folders(tmp_path, "3.13", "3.11") == [(".venv", "3.13"), (".venv-311", "3.11")]
    assert folders(tmp_path, "3.13") == [(".venv", "3.13")]
    assert folders(tmp_path, "3.11") == [(".venv", "3.11")]
    assert folders(tmp_path, "3.12") == []


def test_only_the_main_environment_has_the_development_tools(tmp_path):
    for versions in (["3.13", "3.11"], ["3.11"]):
        main, *others = setup.environments(tmp_path, versions.__contains__)
        assert "develop.txt" in main.requirements
        assert all("develop.txt" not in other.requirements for other in others)


@pytest.mark.parametrize("version", setup.BLENDER_OF_PYTHON)
def test_requirement_files_exist_and_pin_exactly(tmp_path, version):
    (environment,) = setup.environments(tmp_path, version.__eq__)
    for name in environment.requirements:
        lines = (setup.ROOT / "requirements" / name).read_text().splitlines()
        pins = [line for line in lines if line and not line.startswith("#")]
        assert pins
        assert all(line.count("==") == 1 for line in pins)


@pytest.fixture
def ready(tmp_path):
    """An environment that counts as ready."""
    (environment,) = setup.environments(tmp_path, "3.13".__eq__)
    environment.python.parent.mkdir(parents=True)
    environment.python.symlink_to(sys.executable)
    environment.record.write_text(json.dumps({"version": "3.13", "native": "1"}))
    return environment


def test_a_ready_environment_needs_no_python_search(tmp_path, ready):
    assert ready.installed()["native"] == "1"
    assert folders(tmp_path) == [(".venv", "3.13")]


def test_an_environment_of_another_python_is_made_anew(ready):
    ready.record.write_text(json.dumps({"version": "3.11"}))
    assert ready.installed() == {}


def test_an_environment_whose_python_is_gone_is_made_anew(ready):
    ready.python.unlink()
    ready.python.symlink_to("gone")
    assert ready.installed() == {}


@pytest.mark.parametrize("text", ["", "{", "[]"])
def test_a_broken_record_counts_as_absent(ready, text):
    ready.record.write_text(text)
    assert ready.installed() == {}


def test_sources_digest_follows_names_and_bytes(tmp_path):
    def digest():
        return native_wheel.sources_digest(tmp_path)

    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "a.cpp").write_text("int a;")
    first = digest()
    (tmp_path / "build").mkdir()
    (tmp_path / "build" / "a.o").write_text("made")
    assert digest() == first
    (tmp_path / "src" / "a.cpp").write_text("int b;")
    second = digest()
    assert second != first
    (tmp_path / "src" / "a.cpp").rename(tmp_path / "src" / "b.cpp")
    assert digest() not in {first, second}
