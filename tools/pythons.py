"""Find Pythons that can make a virtual environment and compile an extension module."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from .system import Fault, apt_knows

# Prints three lines: version, the interpreter itself (not a shim in front of it), what it lacks.
_PROBE = """
import importlib.util, os, sys, sysconfig
lacks = []
if not (importlib.util.find_spec("venv") and importlib.util.find_spec("ensurepip")):
    lacks.append("venv")
if not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")):
    lacks.append("Python.h")
if sysconfig.get_config_var("Py_GIL_DISABLED"):
    lacks.append("GIL")
print("%d.%d" % sys.version_info[:2], sys.executable, " ".join(lacks), sep="\\n")
"""


@dataclass(frozen=True)
class Interpreter:
    """A Python that runs, and what it lacks: any of "venv", "Python.h" and "GIL"."""

    path: Path
    version: str
    lacks: tuple[str, ...] = ()


def probe(command: str) -> Interpreter | None:
    """Run `command` as a Python; None when it does not run (as a shim of an absent version)."""
    try:
        result = subprocess.run(
            [command, "-I", "-c", _PROBE], capture_output=True, text=True, timeout=60, check=True
        )
        version, path, lacks = result.stdout.split("\n")[:3]
    except (OSError, ValueError, subprocess.SubprocessError):
        return None
    return Interpreter(Path(path), version, tuple(lacks.split()))


def find(version: str) -> list[Interpreter]:
    """Return the Pythons of this version ("3.13") up to the first complete one, which is last.

    The variable PY313 (PY311, PY314) names the only one to try.
    """
    found: dict[str, Interpreter] = {}  # one for each file, whatever links lead to it
    for command in _candidates(version):
        interpreter = probe(command)
        if interpreter and interpreter.version == version:
            if not interpreter.lacks:
                return [*found.values(), interpreter]
            found[os.path.realpath(interpreter.path)] = interpreter
    return [*found.values()]


def usable(version: str) -> Path | None:
    """Return the first complete Python of this version."""
    found = find(version)
    return found[-1].path if found and not found[-1].lacks else None


def _candidates(version: str) -> Iterator[str]:
    """Yield commands that may be this Python, most deliberate choice first."""
    name = f"python{version}"
    chosen = os.environ.get("PY" + version.replace(".", ""))
    if chosen:
        yield chosen
        return
    for folder in os.environ.get("PATH", "").split(os.pathsep):
        if os.access(os.path.join(folder, name), os.X_OK):
            yield os.path.join(folder, name)
    yield sys.executable
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv")
    yield from _newest_first(pyenv / "versions", f"{version}*/bin/{name}")
    if shutil.which("uv"):
        found = subprocess.run(["uv", "python", "find", version], capture_output=True, text=True)
        yield from found.stdout.splitlines()[:1]
    for folder in ("/usr/local", "/opt"):
        yield from _newest_first(Path(folder), f"bin/{name}")
        yield from _newest_first(Path(folder), f"*/bin/{name}")


def _newest_first(folder: Path, pattern: str) -> list[str]:
    """List what matches, 3.13.10 before 3.13.9."""
    paths = [str(path) for path in folder.glob(pattern)]
    return sorted(paths, key=lambda path: [int(n) for n in re.findall(r"\d+", path)], reverse=True)


def absence(versions: list[str]) -> Fault:
    """Describe that no complete Python of these versions is there, and what brings the first."""
    what = f"Python {' or '.join(versions)} with its venv module and header files"
    for version in versions:
        for interpreter in find(version):
            what += f"\n    ({interpreter.path} lacks {' and '.join(interpreter.lacks)})"
    for version in versions:
        name = f"python{version}"
        if apt_knows(f"{name}-venv"):
            return Fault(what, (name, f"{name}-venv", f"{name}-dev"))
    what += (
        "\n    (no such package is known to apt here: uv installs one with"
        f"\n    `pip install uv && uv python install {versions[0]}`,"
        f" pyenv with `pyenv install {versions[0]}`)"
    )
    return Fault(what, ())
