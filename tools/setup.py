"""Make the virtual environments: `python3 -m tools.setup`. Where nothing changed it does nothing.

`.venv` is for Blender 5.2 where Python 3.13 is there, otherwise for 4.5; `.venv-311` is for 4.5
where both Pythons are there, and left out by `--main-only`.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from . import pythons, system
from .native_wheel import ROOT, native_wheel, sources_digest

BLENDER_OF_PYTHON = {"3.13": "5.2", "3.11": "4.5"}


@dataclass(frozen=True)
class Environment:
    """A virtual environment: its folder, Python version and requirement files."""

    folder: Path
    version: str
    requirements: tuple[str, ...]

    @property
    def python(self) -> Path:
        return self.folder / "bin" / "python"

    @property
    def record(self) -> Path:
        """What is installed, written after each step that succeeded."""
        return self.folder / "nacre.json"

    def installed(self) -> dict[str, str]:
        """Return the record, empty for a folder that is absent, broken or of another Python."""
        try:
            record: dict[str, str] = json.loads(self.record.read_text())
            matches = record["version"] == self.version and self.python.exists()
        except (OSError, ValueError, TypeError, KeyError):
            return {}
        return record if matches else {}


def environments(root: Path, available: Callable[[str], bool]) -> list[Environment]:
    """List the environments to have, the main one first; none where no Python is available."""
    found: list[Environment] = []
    for version, blender in BLENDER_OF_PYTHON.items():
        folder = root / (".venv" if not found else f".venv-{version.replace('.', '')}")
        files = [f"blender-{blender}.txt", "test.txt"] + ["develop.txt"] * (not found)
        environment = Environment(folder, version, tuple(files))
        if environment.installed() or available(version):
            found.append(environment)
    return found


def requirements_digest(environment: Environment) -> str:
    """Return a digest of the bytes of the environment's requirement files."""
    digest = hashlib.sha256()
    for name in environment.requirements:
        digest.update((ROOT / "requirements" / name).read_bytes())
    return digest.hexdigest()


def prepare(environment: Environment, native: str) -> None:
    """Bring one environment up to date; `native` is the digest of the helper's sources."""
    record = environment.installed()
    requirements = requirements_digest(environment)
    if not record:
        blender = BLENDER_OF_PYTHON[environment.version]
        print(f"Making {environment.folder.name}: Python {environment.version}, Blender {blender}")
        shutil.rmtree(environment.folder, ignore_errors=True)
        python = pythons.usable(environment.version)
        subprocess.run([str(python), "-m", "venv", str(environment.folder)], check=True)
        record = {"version": environment.version}
        environment.record.write_text(json.dumps(record))
    if record.get("requirements") != requirements:
        print("Installing packages; the first time this fetches about 400 MB", flush=True)
        folder = ROOT / "requirements"
        _pip(environment, *[f"--requirement={folder / name}" for name in environment.requirements])
        for module in environment.folder.glob("lib/python*/site-packages/bpy/__init__*.so"):
            stop_at(system.extension_module_faults(module))
        record["requirements"] = requirements
        environment.record.write_text(json.dumps(record))
    if record.get("native") != native:
        wheel = native_wheel(environment.python, environment.version, pip=environment.python)
        _pip(environment, "--force-reinstall", "--no-deps", str(wheel))
        record["native"] = native
        environment.record.write_text(json.dumps(record))


def stop_at(faults: list[system.Fault]) -> None:
    """Exit with advice on standard error if there is any fault."""
    if faults:
        sys.exit(system.advice(faults))


def _pip(environment: Environment, *arguments: str) -> None:
    # Progress bars on a terminal, errors alone in a log.
    quiet = () if sys.stdout.isatty() else ("--quiet",)
    pip = (str(environment.python), "-m", "pip", "--disable-pip-version-check", *quiet)
    subprocess.run([*pip, "install", *arguments], check=True)


def main() -> None:
    wanted = environments(ROOT, lambda version: pythons.usable(version) is not None)
    faults = [] if wanted else [pythons.absence(list(BLENDER_OF_PYTHON))]
    if "--missing-packages" in sys.argv:
        sys.stdout.writelines(f"{name}\n" for name in system.packages(faults + system.faults()))
        return
    if "--main-only" in sys.argv:
        wanted = wanted[:1]
    native = sources_digest()
    up_to_date = wanted and all(
        environment.installed().get("native") == native
        and environment.installed().get("requirements") == requirements_digest(environment)
        for environment in wanted
    )
    if up_to_date:
        return
    stop_at(faults + system.faults())
    try:
        for environment in wanted:
            prepare(environment, native)
    except subprocess.CalledProcessError as error:
        command = " ".join(error.cmd)
        sys.exit(
            f"Setting up stopped; the lines above say why. The failed command was:\n  {command}"
        )


if __name__ == "__main__":
    main()
