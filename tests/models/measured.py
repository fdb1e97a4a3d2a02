"""The measured materials, imported once for all tests of a session."""

import os
from functools import lru_cache
from pathlib import Path

import pytest

from addon.datasets.dataset import Dataset
from addon.datasets.importing import import_dataset

ROOT = Path(__file__).resolve().parents[2]
WOOL = "wool_W64xH64_L81xV81.btf"
WEAVE = "weave_W64xH64_L81xV81.btf"


def measured(name: str, folders: pytest.TempPathFactory) -> Dataset:
    """A measured file as a dataset; skips the test where the file is not there."""
    shared = Path(os.environ.get("NACRE_SHARED_DATA") or ROOT.parent / "shared" / "data")
    for path in (ROOT / "samples" / name, shared / "btf" / name):
        if path.is_file():
            return _imported(path, folders)
    pytest.skip(f"{name} is neither in samples/ nor in the folder NACRE_SHARED_DATA")


@lru_cache
def _imported(path: Path, folders: pytest.TempPathFactory) -> Dataset:
    return import_dataset(path, folders.mktemp("measured") / f"{path.stem}.nacre")
