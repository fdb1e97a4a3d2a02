"""Build the compiled helper's wheel for one Python, once for each state of its sources."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_NOT_SOURCES = {"__pycache__", "build", "dist", "tests"}


def sources_digest(folder: Path = ROOT / "native") -> str:
    """Return a digest of the names and bytes of every source file in `folder`, tests left out."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        if path.is_file() and not _NOT_SOURCES.intersection(parts) and parts[0][0] != ".":
            digest.update("/".join(parts).encode() + b"\0")
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def native_wheel(python: Path, version: str, pip: Path) -> Path:
    """Return the helper's wheel for `python` of `version` ("3.13"), built if sources have changed.

    `pip` is a Python that has pip; `python` needs none. Raises subprocess.CalledProcessError
    when the build fails; its output has been printed then.
    """
    folder = ROOT / "build" / "wheels" / f"cp{version.replace('.', '')}"
    stamp = folder / "sources.sha256"
    digest = sources_digest()
    if not (stamp.is_file() and stamp.read_text() == digest):
        shutil.rmtree(folder, ignore_errors=True)
        print(f"Building the compiled helper for Python {version}", flush=True)
        command = [str(pip), "-m", "pip", "--python", str(python), "wheel", "--quiet", "--no-deps"]
        subprocess.run([*command, "--wheel-dir", str(folder), str(ROOT / "native")], check=True)
        stamp.write_text(digest)
    return next(folder.glob("*.whl"))
