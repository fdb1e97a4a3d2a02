"""The measured materials, imported and compressed once for all tests of a session."""

import os
from functools import lru_cache
from pathlib import Path

import pytest

from addon.cli import main

ROOT = Path(__file__).resolve().parents[2]
WOOL = "wool_W64xH64_L81xV81.btf"
WEAVE = "weave_W64xH64_L81xV81.btf"
SETTINGS = {
    "nsvd": "--method nsvd --ranks light=20,view=28,y=32,x=32",
    "k3": "--method kcta --ranks light=20,view=4,y=32,x=32 --clusters view=7 --mixtures view=3",
    "k1": "--method kcta --ranks light=20,view=4,y=32,x=32 --clusters view=7 --mixtures view=1",
}


def measured(name: str, folders: pytest.TempPathFactory) -> Path:
    """A measured file as a dataset; skips the test where the file is not there."""
    shared = Path(os.environ.get("NACRE_SHARED_DATA") or ROOT.parent / "shared" / "data")
    for path in (ROOT / "samples" / name, shared / "btf" / name):
        if path.is_file():
            return _imported(path, folders.getbasetemp())
    pytest.skip(f"{name} is neither in samples/ nor in the folder NACRE_SHARED_DATA")


def compressed(name: str, setting: str, folders: pytest.TempPathFactory) -> Path:
    """A measured file compressed with one of SETTINGS."""
    return _compressed(measured(name, folders), setting)


@lru_cache
def _imported(source: Path, folder: Path) -> Path:
    path = folder / f"{source.stem}.nacre"
    assert main(["import", str(source), str(path), "--json"]) == 0
    return path


@lru_cache
def _compressed(dataset: Path, setting: str) -> Path:
    path = dataset.with_name(f"{dataset.stem}-{setting}.exr")
    assert main(["compress", str(dataset), str(path), *SETTINGS[setting].split(), "--json"]) == 0
    return path
