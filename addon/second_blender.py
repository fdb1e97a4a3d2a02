"""Another Blender for long work on a copy of the file: this one stays usable, and untouched."""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import bpy

from .errors import NacreError

POLL_SECONDS = 0.2


def save_copy(folder: str) -> Path:
    """Write the present state of the file into a folder."""
    path = Path(folder) / (bpy.path.basename(bpy.data.filepath) or "unsaved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    return path


def nacre_command(*arguments: str) -> list[str]:
    """A command line of Nacre for another Blender."""
    return [bpy.app.binary_path, "--background", "--command", "nacre", *arguments]


def follow(command: Sequence[str], look: Callable[[], None]) -> None:
    """Run a command to its end, looking at its work again and again.

    The command is killed when `look` raises. Raises NacreError with the mistake that it reported.
    """
    with tempfile.TemporaryFile() as errors:
        child = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors
        )
        try:
            while child.poll() is None:
                look()
                time.sleep(POLL_SECONDS)
        finally:
            child.kill()
            child.wait()
        if child.returncode:
            errors.seek(0)
            lines = errors.read().decode("utf-8", "replace").splitlines()
            said = [line.removeprefix("nacre: ") for line in lines if line.startswith("nacre: ")]
            raise NacreError(said[-1] if said else "the other Blender ended without a result")
