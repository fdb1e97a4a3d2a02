"""A bound on memory holds for whole fits, and changes nothing else."""

import sys

import numpy as np
import pytest

from benchmarks._child import measured

from . import memory_jobs
from .test_nsvd import resident

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="memory bounds need Linux")


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """81 MB of half floats; the reduced tensor of the fit has 50 MB, and there are two such."""
    path = tmp_path_factory.mktemp("memory") / "samples.npy"
    samples = np.random.default_rng(4).random((13, 16, 256, 256, 3), np.float32)
    np.save(path, samples.astype(np.float16))
    return path


def test_the_process_stays_below_the_bound(path, tmp_path):
    memory = 200_000_000
    free = measured(memory_jobs.opened, memory_jobs.fit, path, 0, "")
    bounded = measured(memory_jobs.opened, memory_jobs.fit, path, memory, str(tmp_path))
    interpreter = 20_000_000  # at least, and it counts
    assert bounded.peak < memory - interpreter < free.peak
    assert bounded.value == free.value
    assert not list(tmp_path.iterdir())


def test_pages_are_dropped_behind_the_reader(path, tmp_path):
    samples = np.load(path, mmap_mode="r")
    memory_jobs.fit((samples, 0, ""))
    assert resident(path) > 0.9 * samples.nbytes
    memory_jobs.fit((samples, 1, str(tmp_path)))
    assert resident(path) < 20_000
