"""Find what the system lacks, and name the Debian and Ubuntu packages that bring it."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

# What the bpy wheels load from the system, and who brings it.
LIBRARY_PACKAGES = {
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libICE.so.6": "libice6",
    "libSM.so.6": "libsm6",
    "libX11.so.6": "libx11-6",
    "libXext.so.6": "libxext6",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libXrender.so.1": "libxrender1",
    "libxkbcommon.so.0": "libxkbcommon0",
}

# EEVEE draws without a screen through EGL; Mesa does it where there is no graphics card.
_OPENGL_PROBE = """
import ctypes, sys
egl = ctypes.CDLL("libEGL.so.1")
egl.eglGetDisplay.restype = egl.eglGetPlatformDisplay.restype = ctypes.c_void_p
surfaceless_mesa, opengl_api = 0x31DD, 0x30A2
displays = [egl.eglGetDisplay(None), egl.eglGetPlatformDisplay(surfaceless_mesa, None, None)]
works = any(egl.eglInitialize(ctypes.c_void_p(display), None, None) for display in displays)
sys.exit(0 if works and egl.eglBindAPI(opengl_api) else 1)
"""

_CXX_PROBE = "#include <span>\nint main() { return std::span<int>().size(); }\n"


@dataclass(frozen=True)
class Fault:
    """Something the system lacks, and the packages that bring it."""

    what: str
    packages: tuple[str, ...]


def faults() -> list[Fault]:
    """List what building and running Nacre needs and the system lacks, except Python itself."""
    found = [library_fault(library) for library in LIBRARY_PACKAGES if not _loads(library)]
    if not _succeeds([sys.executable, "-c", _OPENGL_PROBE]):
        packages = ("libegl1", "libgl1", "libgl1-mesa-dri")
        found.append(Fault("an OpenGL driver that works without a screen", packages))
    if not compiler():
        found.append(Fault("a C++20 compiler", ("g++",)))
    return found


def library_fault(library: str) -> Fault:
    """Describe a missing shared library; one that no table names has no package."""
    package = LIBRARY_PACKAGES.get(library)
    return Fault(f"the shared library {library}", (package,) if package else ())


def compiler() -> str | None:
    """Return the first of $CXX, c++ and g++ that compiles C++20."""
    for command in (os.environ.get("CXX", ""), "c++", "g++"):
        check = [*command.split(), "-std=c++20", "-fsyntax-only", "-x", "c++", "-"]
        if command and _succeeds(check, _CXX_PROBE):
            return command
    return None


def missing_libraries(ldd_output: str) -> list[str]:
    """Return the names that the text printed by ldd calls not found, each once."""
    lines = [line.split("=>") for line in ldd_output.splitlines()]
    return sorted({pair[0].strip() for pair in lines if pair[-1].strip() == "not found"})


def extension_module_faults(module: Path) -> list[Fault]:
    """List the shared libraries that a compiled Python module asks for in vain."""
    result = subprocess.run(["ldd", str(module)], capture_output=True, text=True)
    return [library_fault(library) for library in missing_libraries(result.stdout)]


def apt_knows(package: str) -> bool:
    """Say whether this system's package lists have the package."""
    return _succeeds(["apt-cache", "show", package])


def advice(missing: Iterable[Fault]) -> str:
    """Say what is missing and the command that installs it."""
    missing = list(missing)
    lines = ["Nacre needs, and this system lacks:"]
    lines += [f"  {fault.what}" for fault in missing]
    names = packages(missing)
    if names:
        lines += ["Install them, then run make again. On Debian and Ubuntu:"]
        lines += [f"  sudo apt-get install {' '.join(names)}"]
    return "\n".join(lines)


def packages(missing: Iterable[Fault]) -> list[str]:
    """Return the packages that bring what is missing, sorted, each once."""
    return sorted({package for fault in missing for package in fault.packages})


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _succeeds(command: list[str], stdin: str = "") -> bool:
    try:
        result = subprocess.run(command, input=stdin.encode(), capture_output=True, timeout=60)
    except (OSError, subprocess.SubprocessError):
        return False
    return result.returncode == 0
