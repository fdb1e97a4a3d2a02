"""Where the measured files are, and what every import must leave behind."""

import os
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]

# btf_writer and image_zips lie beside the tests.
sys.path.insert(0, str(HERE))


@pytest.fixture(scope="session")
def measured_file():
    """A function that finds a measured file by its name or skips the test."""

    def find(name: str) -> Path:
        shared = os.environ.get("NACRE_SHARED_DATA") or ROOT.parent / "shared" / "data"
        for path in (ROOT / "samples" / name, Path(shared) / "btf" / name):
            if path.is_file():
                return path
        pytest.skip(f"{name} is neither in samples/ nor in the folder NACRE_SHARED_DATA")

    return find
