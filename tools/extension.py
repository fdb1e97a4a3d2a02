"""Stage, build and validate the extension: `python -m tools.extension [EXTRA_WHEELS]`.

Blender wants one folder with the manifest beside the package's `__init__.py`, so a copy laid out
that way is made in build/stage; Blender's own tool, which the bpy wheel carries, does the rest.
"""

import shutil
import subprocess
import sys
import sysconfig
import tomllib
from collections.abc import Iterable
from pathlib import Path

from . import extension_wheels
from .native_wheel import ROOT


def stage(root: Path, destination: Path) -> None:
    """Copy what the extension is made of from the checkout `root`, but for the wheels."""
    shutil.rmtree(destination, ignore_errors=True)
    shutil.copytree(root / "addon", destination, ignore=shutil.ignore_patterns("__pycache__"))
    if (root / "shaders").is_dir():
        shutil.copytree(root / "shaders", destination / "shaders")
    for name in ("blender_manifest.toml", "LICENSE"):
        shutil.copy2(root / name, destination)


def list_wheels(manifest: Path, names: Iterable[str]) -> None:
    """Write the wheels' file names into the manifest's empty list."""
    text = manifest.read_text()
    assert text.count("\nwheels = []\n") == 1, "the manifest has no line `wheels = []` to fill"
    lines = "".join(f'    "./wheels/{name}",\n' for name in names)
    manifest.write_text(text.replace("\nwheels = []\n", f"\nwheels = [\n{lines}]\n"))


def blender_tool(*arguments: str) -> None:
    """Run Blender's extension tool; exits when it finds a fault, which it has then printed."""
    packages = Path(sysconfig.get_path("purelib"))
    (tool,) = packages.glob("bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py")
    scripts = tool.parents[3]
    tags = scripts / "modules" / "_bpy_internal" / "extensions" / "tags.py"
    command = [sys.executable, str(tool), *arguments, f"--valid-tags={tags}"]
    if subprocess.run(command).returncode:
        sys.exit("error: Blender's extension tool refused the extension")


def build(folder: Path, archive: Path) -> None:
    """Build the archive from the staged folder and validate it."""
    archive.parent.mkdir(exist_ok=True)
    blender_tool("build", f"--source-dir={folder}", f"--output-filepath={archive}")
    blender_tool("validate", str(archive))


def main() -> None:
    extra = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    folder = ROOT / "build" / "stage"
    stage(ROOT, folder)
    wheels = extension_wheels.gather(folder / "wheels", extra)
    list_wheels(folder / "blender_manifest.toml", [wheel.name for wheel in wheels])
    version = tomllib.loads((ROOT / "blender_manifest.toml").read_text())["version"]
    archive = ROOT / "dist" / f"nacre-{version}.zip"
    build(folder, archive)
    print(f"Built {archive.relative_to(ROOT)}: {archive.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
