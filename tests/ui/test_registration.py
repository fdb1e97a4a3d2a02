"""The extension comes and goes without a trace, and speaks the user's language."""

import ast
import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import bpy
import pytest

import addon
from addon import operators, panels, properties, wheels
from addon.datasets.importing import READERS

ROOT = Path(__file__).resolve().parents[2]
CLASSES = (*properties.CLASSES, *operators.CLASSES, *panels.CLASSES)
OPERATORS = [cls for cls in operators.CLASSES if issubclass(cls, bpy.types.Operator)]
PREFIXES = {
    bpy.types.Operator: "OT",
    bpy.types.Panel: "PT",
    bpy.types.FileHandler: "FH",
    bpy.types.PropertyGroup: "PG",
}


def names(cls):
    return {prefix for base, prefix in PREFIXES.items() if issubclass(cls, base)}


def registered() -> set[str]:
    found = {name for name in dir(bpy.types) if "nacre" in name.lower()}
    found |= {
        f"{owner.__name__}.nacre"
        for owner in (bpy.types.Scene, bpy.types.Material)
        if hasattr(owner, "nacre")
    }
    entries = bpy.types.TOPBAR_MT_file_import._dyn_ui_initialize()
    return found | {entry.__module__ for entry in entries if "import_btf" in entry.__module__}


def test_it_goes_without_a_trace_and_comes_again():
    before = registered()
    assert {cls.__name__ for cls in (*operators.CLASSES, *panels.CLASSES)} <= before
    for _ in range(2):
        addon.unregister()
        assert registered() == set()
        addon.register()
        assert registered() == before


def test_the_package_imports_nothing_of_itself():
    tree = ast.parse((ROOT / "addon" / "__init__.py").read_text())
    assert not [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: cls.__name__)
def test_class_names_tell_what_they_are(cls):
    (kind,) = names(cls)
    assert re.fullmatch(rf"NACRE_{kind}_[a-z_]+", cls.__name__)


@pytest.mark.parametrize("cls", OPERATORS, ids=lambda cls: cls.__name__)
def test_an_operator_is_named_after_its_class(cls):
    assert cls.bl_idname == "nacre." + cls.__name__.removeprefix("NACRE_OT_")


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: cls.__name__)
def test_labels_are_title_case_and_everything_has_a_tip(cls):
    rna, tips = cls.bl_rna, []
    if issubclass(cls, bpy.types.Operator):
        rna, tips = getattr(bpy.ops.nacre, cls.bl_idname[6:]).get_rna_type(), [cls.__doc__]
    labels = [getattr(cls, "bl_label", "")]
    annotated = {name for base in cls.__mro__ for name in getattr(base, "__annotations__", ())}
    for name in sorted(annotated & set(rna.properties.keys())):
        prop = rna.properties[name]
        if prop.is_hidden:
            continue
        tips.append(prop.description)
        labels.append(prop.name)
        if prop.type == "ENUM":
            tips += [item.description for item in prop.enum_items]
            labels += [item.name for item in prop.enum_items]
    for tip in tips:
        assert tip and not tip.endswith(".") and tip[0].isupper(), tip
    for label in labels:
        assert not [w for w in label.split() if w[0].islower() and w not in ("sRGB", "with")], label


def test_files_can_be_dropped_on_the_viewport():
    (handler,) = (cls for cls in operators.CLASSES if issubclass(cls, bpy.types.FileHandler))
    assert handler.bl_import_operator == "nacre.import_btf"
    endings = {ending for reader in READERS.values() for ending in reader.EXTENSIONS}
    assert endings >= {".btf", ".zip", ".bsdf", ".pbsdf", ".binary", ".bin", ".npy"}
    assert set(handler.bl_file_extensions.split(";")) == endings
    glob = bpy.ops.nacre.import_btf.get_rna_type().properties["filter_glob"].default
    assert set(glob.split(";")) == {f"*{ending}" for ending in endings}


def test_the_command_line_is_there(tmp_path):
    """Blender hands the arguments over and takes the exit status."""
    script = textwrap.dedent("""
        import bpy, addon, sys
        bpy.utils.register_cli_command = lambda name, run: commands.append((name, run)) or name
        bpy.utils.unregister_cli_command = lambda handle: commands.pop()
        commands = []
        addon.register()
        (name, run), = commands
        assert name == "nacre"
        status = run(["info", "absent.btf"])
        addon.unregister()
        assert not commands
        sys.exit(status)
    """)
    result = run_python(script, tmp_path)
    assert result.returncode == 2, result.stderr
    assert "absent.btf" in result.stderr


def test_without_its_compiled_packages_it_registers_and_says_what_is_missing(tmp_path):
    script = textwrap.dedent("""
        import sys
        sys.modules["nacre_native"] = None
        import bpy, addon
        addon.register()
        from addon import panels, wheels
        print(wheels.missing())
        for cls in panels.CLASSES:
            if cls.poll(bpy.context):
                print("panel", cls.__name__)
        settings = bpy.context.scene.nacre
        settings.dataset = settings.model = "x"
        for name in ("import_btf", "compress", "create_material"):
            try:
                getattr(bpy.ops.nacre, name)()
            except RuntimeError as error:
                print(error)
        addon.unregister()
    """)
    result = run_python(script, tmp_path)
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    assert lines[0].startswith("The package nacre_native is missing: install it for Python 3.")
    assert lines[1] == "panel NACRE_PT_missing_wheels"
    assert sum("nacre_native is missing" in line for line in lines) == 4, result.stdout


def test_a_manifest_tells_whom_there_are_wheels_for(tmp_path):
    manifest = tmp_path / "blender_manifest.toml"
    assert wheels.wheel_targets(manifest) == ""
    manifest.write_text("wheels = [\n]\n")
    assert wheels.wheel_targets(manifest) == ""
    files = (
        "nacre_native-0.1.0-cp313-cp313-manylinux_2_34_x86_64.whl",
        "nacre_native-0.1.0-cp311-cp311-manylinux_2_27_x86_64.manylinux_2_28_x86_64.whl",
        "nacre_native-0.1.0-cp311-cp311-macosx_11_0_arm64.whl",
        "nacre_native-0.1.0-cp313-cp313-win_amd64.whl",
        "openexr-3.5.3-cp314-cp314-manylinux_2_28_x86_64.whl",
    )
    manifest.write_text(f"wheels = {[f'./wheels/{name}' for name in files]}\n")
    assert wheels.wheel_targets(manifest) == (
        "Linux x86_64 (Python 3.11, 3.13); macOS arm64 (Python 3.11); win_amd64 (Python 3.13)"
    )


def test_a_package_that_does_not_load_is_told_from_a_missing_one(monkeypatch):
    def fail(name):
        raise ImportError("libm.so.6: version `GLIBC_2.99' not found\nmore", name=name)

    monkeypatch.setattr(wheels.importlib, "import_module", fail)
    text = wheels.missing.__wrapped__()
    assert text.startswith("The package nacre_native cannot be loaded (libm.so.6: version")
    assert "\n" not in text


def run_python(script, folder):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, "-c", script], cwd=folder, env=environment, capture_output=True, text=True
    )
