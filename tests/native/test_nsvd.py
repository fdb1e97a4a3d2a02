"""N-SVD through the bindings."""

import sys
from pathlib import Path

import nacre_native
import numpy as np
import pytest

from . import reference

RANKS = (6, 4, 4, 3)

linux = pytest.mark.skipif(sys.platform != "linux", reason="memory bounds need Linux")


def assert_same_bits(first, second):
    np.testing.assert_array_equal(first["core"], second["core"])
    for a, b in zip(first["basis"], second["basis"], strict=True):
        np.testing.assert_array_equal(a, b)
    for name in ("errors", "squared_norm", "iterations"):
        assert first[name] == second[name]


def resident(path):
    """Bytes of a mapped file that are in this process's memory."""
    inside, total = False, 0
    for line in Path("/proc/self/smaps").read_text().splitlines():
        first = line.split()[0]
        if not first.endswith(":"):
            inside = line.endswith(str(path))
        elif inside and first == "Rss:":
            total += 1024 * int(line.split()[1])
    return total


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
    assert_same_bits(*(nacre_native.fit_nsvd(samples, RANKS, threads=n) for n in (1, 2)))


def test_no_iterations_give_the_truncated_hosvd(samples):
    model = nacre_native.fit_nsvd(samples, RANKS, iterations=0)
    a = reference.tensor_of(samples)
    for mode, rank in enumerate(RANKS):
        u = reference.leading(a, mode, rank)
        a = reference.mode_product(a, u.T, mode)
        mine = model["basis"][mode][0, :, 0]
        np.testing.assert_allclose(np.abs(np.sum(u * mine, axis=0)), 1, atol=1e-4)
    norm = np.sum(np.square(samples, dtype=float))
    assert model["errors"] == [pytest.approx(1 - np.sum(a**2) / norm, rel=1e-4)]
    assert (model["iterations"], model["passes"]) == (0, 2)


def test_a_fit_that_was_stopped_goes_on_to_the_same_bits(samples):
    settings = {"iterations": 5, "tolerance": 0}
    states = []
    whole = nacre_native.fit_nsvd(samples, RANKS, checkpoint=states.append, **settings)
    assert len(states) == whole["iterations"] == 5
    assert whole["passes"] == 2 + 1 + 4 * 2
    for state in states:
        resumed = nacre_native.fit_nsvd(samples, RANKS, start=state, **settings)
        assert_same_bits(resumed, whole)
        assert resumed["passes"] == whole["passes"]

    def stop(model):
        raise RuntimeError("full")

    with pytest.raises(RuntimeError, match="full"):
        nacre_native.fit_nsvd(samples, RANKS, checkpoint=stop)


def test_a_start_that_does_not_fit(samples):
    model = nacre_native.fit_nsvd(samples, RANKS)
    with pytest.raises(ValueError, match="start: expected a model with basis"):
        nacre_native.fit_nsvd(samples, RANKS, start={"core": model["core"]})
    for other in (samples[:5], np.ascontiguousarray(samples[:, :20])):
        with pytest.raises(ValueError, match="start: expected a model of the same shape and ranks"):
            nacre_native.fit_nsvd(other, RANKS, start=model)
    with pytest.raises(ValueError, match="start: expected a model of the same shape and ranks"):
        nacre_native.fit_nsvd(samples, (6, 4, 3, 4), start=model)
    with pytest.raises(ValueError, match="start: expected an error for each iteration"):
        nacre_native.fit_nsvd(samples, RANKS, start={**model, "iterations": 99})


@linux
def test_a_memory_bound_changes_no_bit(samples, tmp_path):
    bounded = nacre_native.fit_nsvd(samples, RANKS, memory=1, scratch=str(tmp_path))
    assert_same_bits(bounded, nacre_native.fit_nsvd(samples, RANKS))
    assert not list(tmp_path.iterdir())
    with pytest.raises(RuntimeError, match="scratch: cannot put 1 MB in .*: No such file"):
        nacre_native.fit_nsvd(samples, RANKS, memory=1, scratch=str(tmp_path / "none"))


@linux
def test_pages_are_dropped_behind_the_reader_but_only_if_they_can_be_read_again(tmp_path):
    path = tmp_path / "samples.npy"
    samples = np.random.default_rng(4).random((8, 24, 64, 64, 3), np.float32).astype(np.float16)
    np.save(path, samples)
    ranks, settings = (4, 4, 8, 8), {"iterations": 2, "tolerance": 0}
    expected = nacre_native.fit_nsvd(samples, ranks, **settings)

    mapped = np.load(path, mmap_mode="r")
    for view in (mapped, np.asarray(mapped)[:]):
        assert_same_bits(nacre_native.fit_nsvd(view, ranks, **settings), expected)
        assert resident(path) > 0.9 * samples.nbytes
        bounded = nacre_native.fit_nsvd(view, ranks, memory=1, scratch=str(tmp_path), **settings)
        assert_same_bits(bounded, expected)
        assert resident(path) < 20_000

    copy_on_write = np.load(path, mmap_mode="c")
    copy_on_write[:] *= 2
    bounded = nacre_native.fit_nsvd(
        copy_on_write, ranks, memory=1, scratch=str(tmp_path), **settings
    )
    np.testing.assert_array_equal(copy_on_write, samples * 2)
    np.testing.assert_array_equal(bounded["core"], 2 * expected["core"])


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
