"""What the benchmarks measure with: memory of a process, counts of operations, materials."""

import os

import nacre_native
import numpy as np
import pytest

from benchmarks._child import measured
from benchmarks._fits import Settings
from benchmarks._materials import patches
from benchmarks._operations import Counts, Work

from .jobs import fill

SHAPE = (18, 9, 6, 5)
KCTA = Settings((6, 2, 4, 3), {1: 3}, {1: 2}, (0,))
MKCTA = Settings((2, 2, 4, 3), {0: 2, 1: 3}, {0: 2, 1: 2}, (2, 3))
NSVD = Settings((6, 4, 4, 3), {}, {}, ())


def test_peak_memory_is_that_of_the_job_alone():
    found = measured(int, fill, 200)
    assert found.value == 200 << 20
    assert 200e6 < found.peak < 230e6
    assert found.seconds > 0


def test_a_process_that_dies_is_an_error():
    with pytest.raises(RuntimeError, match="ended early"):
        measured(int, os._exit, 1)


def test_the_slower_of_products_and_memory_counts():
    assert Work(100, 10).seconds(products=10, moved=10) == 10
    assert Work(100, 200).seconds(products=10, moved=10) == 20


@pytest.mark.parametrize("settings", [NSVD, KCTA, MKCTA], ids=["nsvd", "kcta", "mkcta"])
def test_every_stage_of_a_fit_has_a_formula(settings):
    samples = np.random.default_rng(0).random((6, 9, 6, 5, 3), np.float32)
    messages = set()

    def progress(_fraction, message):
        messages.add(message)
        return True

    if not settings.clusters:
        nacre_native.fit_nsvd(samples, settings.ranks, progress=progress)
    else:
        nacre_native.fit_clustered(
            samples,
            settings.ranks,
            clusters=settings.clusters,
            mixtures=settings.mixtures,
            global_modes=settings.global_modes,
            directions={mode: np.eye(samples.shape[mode]) for mode in settings.clusters},
            progress=progress,
        )
    counts = Counts(SHAPE, settings)
    for message in messages:
        work = counts.stage(message, mixtures=True)
        assert all(part.operations > 0 and part.bytes > 0 for part in work)
        assert bool(work) == (message.split()[-1].lower() not in ("done", "core"))


def test_counts_by_hand():
    """Products written out mode by mode, for shapes small enough to do so."""
    size = 18 * 9 * 6 * 5
    counts = Counts(SHAPE, KCTA)
    assert counts.stage("Global basis: covariance", True) == [Work(19 * size, 2 * size)]
    (projection,) = counts.stage("Projection on the global bases", True)
    assert projection == Work(2 * 6 * size, 2 * size + 4 * 6 * 9 * 6 * 5)
    (clustering,) = counts.stage("Iteration 1: clustering", True)
    (decomposition,) = counts.stage("Iteration 1: decomposition", True)
    spread = 3 * (2 * (2 * 6 * 4 * 3) * 5 + 2 * (2 * 6 * 4 * 5) * 6)
    assert clustering.operations == spread + 2 * 9 * 6 * 180 + 6 * 7 * 180
    members = 2 * 9 / 3
    others = 2 * members * 2 * 180
    view = 2 * members * 6 * (6 * 5 * 3 + 6 * 4 * 3) + members * (members + 1) * 6 * 4 * 3
    lead = 2 * 2 * members * 180
    bases = 2 * 2 * 6 * (6 * 5 * 3 + 6 * 5 * 4 + 4 * 5 * 3)
    grams = 6 * 7 * 2 * 6 * 3 + 5 * 6 * 2 * 6 * 4
    assert decomposition.operations == 3 * (others + view + lead + bases + grams)


def test_the_patches_of_a_larger_material_differ():
    images = np.random.default_rng(0).random((2, 32, 32, 3), np.float32)
    larger = patches(images)
    assert larger.shape == (2, 64, 64, 3) and np.isfinite(larger).all()
    np.testing.assert_array_equal(larger[:, :32, :32], images)
    # No patch is a combination of the others: four of them, rank four.
    parts = [larger[0, y : y + 32, x : x + 32].ravel() for y in (0, 32) for x in (0, 32)]
    assert np.linalg.cond(np.array(parts)) < 50
