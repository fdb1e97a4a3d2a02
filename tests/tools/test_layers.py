"""The layers of addon/ keep to themselves: `docs/architecture.md` says why."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ADDON = Path(__file__).resolve().parents[2] / "addon"
WITHOUT_BLENDER = ("errors.py", "samples.py", "datasets", "models", "tables")
BLENDER_MODULES = {"bpy", "bmesh", "gpu", "mathutils", "bl_math", "bpy_extras", "blf"}


def imports(path: Path) -> Iterator[tuple[int, str]]:
    """Every import in a file, also those inside functions, as (level, dotted name)."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((0, name.name) for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.level, node.module or ""


def files(*names: str) -> list[Path]:
    found = [path for name in names for path in [ADDON / name, *(ADDON / name).rglob("*.py")]]
    return [path for path in found if path.is_file()]


@pytest.mark.parametrize("path", files(*WITHOUT_BLENDER), ids=lambda path: path.stem)
def test_data_layers_never_import_blender(path):
    used = {name.split(".")[0] for level, name in imports(path) if level == 0}
    assert not used & BLENDER_MODULES


@pytest.mark.parametrize("path", files("."), ids=lambda path: path.stem)
def test_own_parts_are_imported_relatively(path):
    assert "addon" not in {name.split(".")[0] for level, name in imports(path) if level == 0}


def test_data_flows_one_way():
    """dataset -> model -> tables: no layer imports a later one."""
    layers = ["datasets", "models", "tables"]
    for position, layer in enumerate(layers):
        for path in files(layer):
            from_addon = {name.split(".")[0] for level, name in imports(path) if level == 2}
            assert not from_addon & set(layers[position + 1 :]), path
