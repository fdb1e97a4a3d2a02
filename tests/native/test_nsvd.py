"""N-SVD through the bindings."""

import nacre_native
import numpy as np
import pytest

from . import reference

RANKS = (6, 4, 4, 3)


def test_error_is_that_of_the_reconstruction(samples):
    model = nacre_native.fit_nsvd(samples, RANKS)
    assert model["core"].shape == (1, *RANKS)
    assert [b.shape for b in model["basis"]] == [
        (1, 18, 1, 6),
        (1, 24, 1, 4),
        (1, 8, 1, 4),
        (1, 7, 1, 3),
    ]
    assert reference.relative_error(samples, model) == pytest.approx(model["errors"][-1], rel=1e-3)
    assert np.all(np.diff(model["errors"]) <= 0)
    assert model["iterations"] == len(model["errors"])
    for basis in model["basis"]:
        u = basis[0, :, 0].astype(np.float64)
        np.testing.assert_allclose(u.T @ u, np.eye(u.shape[1]), atol=1e-6)


def test_equals_alternating_least_squares(samples):
    model = nacre_native.fit_nsvd(samples, RANKS, iterations=50, tolerance=0)
    a = reference.tensor_of(samples)
    bases = [reference.leading(a, n, r) for n, r in enumerate(RANKS)]
    for _ in range(50):
        for n, rank in enumerate(RANKS):
            bases[n] = reference.leading(reference.project(a, bases, n), n, rank)
    error = 1 - np.sum(reference.project(a, bases) ** 2) / np.sum(a**2)
    assert model["errors"][-1] == pytest.approx(error, rel=1e-3)


def test_full_ranks_are_exact(samples):
    model = nacre_native.fit_nsvd(samples, (18, 24, 8, 7))
    assert reference.relative_error(samples, model) < 1e-9


def test_half_and_float_agree(samples):
    half = samples.astype(np.float16)
    first = nacre_native.fit_nsvd(half, RANKS)
    second = nacre_native.fit_nsvd(half.astype(np.float32), RANKS)
    np.testing.assert_array_equal(first["core"], second["core"])
    assert first["errors"] == second["errors"]


def test_same_bits_for_any_threads(samples):
    first, second = (nacre_native.fit_nsvd(samples, RANKS, threads=n) for n in (1, 2))
    np.testing.assert_array_equal(first["core"], second["core"])
    for a, b in zip(first["basis"], second["basis"], strict=True):
        np.testing.assert_array_equal(a, b)


def test_scaling_scales_the_core_alone(samples):
    first = nacre_native.fit_nsvd(samples, RANKS)
    second = nacre_native.fit_nsvd(samples * np.float32(4), RANKS)
    np.testing.assert_allclose(second["core"], 4 * first["core"], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(second["basis"][2], first["basis"][2], atol=1e-6)


@pytest.mark.parametrize("value", [0.0, 0.25])
def test_constant_tensors(value):
    samples = np.full((3, 4, 5, 6, 3), value, np.float16)
    model = nacre_native.fit_nsvd(samples, (2, 2, 2, 2))
    np.testing.assert_allclose(reference.reconstruct(model), value, atol=1e-6)
    assert model["errors"][-1] < 1e-6


@pytest.mark.parametrize(
    "shape", [(1, 5, 4, 3, 3), (4, 1, 1, 3, 1), (1, 1, 1, 1, 1), (2, 3, 1, 9, 4)]
)
def test_modes_of_size_one(shape):
    samples = np.random.default_rng(1).random(shape, np.float32)
    full = (shape[0] * shape[4], *shape[1:4])
    assert reference.relative_error(samples, nacre_native.fit_nsvd(samples, full)) < 1e-9


def test_reads_a_read_only_memory_map(samples, tmp_path):
    np.save(tmp_path / "samples.npy", samples)
    mapped = np.load(tmp_path / "samples.npy", mmap_mode="r")
    np.testing.assert_array_equal(
        nacre_native.fit_nsvd(mapped, RANKS)["core"], nacre_native.fit_nsvd(samples, RANKS)["core"]
    )


def test_squared_norm_is_that_of_the_samples():
    samples = np.random.default_rng(3).standard_normal((4, 5, 6, 7, 3)).astype(np.float32)
    expected = np.sum(np.square(samples, dtype=float))
    nsvd = nacre_native.fit_nsvd(samples, (3, 2, 3, 3))
    kcta = nacre_native.fit_clustered(
        samples, (3, 2, 3, 3), clusters={1: 2}, directions={1: np.eye(5)}
    )
    np.testing.assert_allclose([nsvd["squared_norm"], kcta["squared_norm"]], expected, rtol=1e-5)
