"""Sparse tensor decomposition against exact cases and a plain orthogonal matching pursuit."""

import numpy as np
import pytest

from benchmarks._sparse_tensor import (
    Codes,
    SparseTensor,
    best_dictionary,
    fit_sparse_tensor,
    k_svd,
    rotated,
    sparse_codes,
    sparse_tensor_bytes,
)


@pytest.fixture
def generator():
    return np.random.default_rng(7)


def pursuit(dictionary, signal, sparsity):
    """Orthogonal matching pursuit of one signal, as the textbook has it."""
    unit = dictionary / np.linalg.norm(dictionary, axis=1, keepdims=True)
    chosen, left = [], signal
    for _ in range(sparsity):
        scores = np.abs(unit @ left)
        scores[chosen] = -1.0
        chosen.append(int(np.argmax(scores)))
        values = np.linalg.lstsq(dictionary[chosen].T, signal, rcond=None)[0]
        left = signal - values @ dictionary[chosen]
    return chosen, values


def sparse_signals(generator, dictionary, count, sparsity):
    index = np.argsort(generator.random((count, len(dictionary))), axis=1)[:, :sparsity]
    return Codes(index, generator.uniform(1, 2, index.shape)).dense(len(dictionary)) @ dictionary


def relative_error(signals, approximation):
    return np.sum((signals - approximation) ** 2) / np.sum(signals**2)


def test_codes_are_those_of_orthogonal_matching_pursuit(generator):
    dictionary = generator.normal(size=(30, 12)) * generator.uniform(0.1, 5, (30, 1))
    signals = generator.normal(size=(40, 12))
    codes = sparse_codes(dictionary, signals, 5, block=7)
    for i, signal in enumerate(signals):
        index, value = pursuit(dictionary, signal, 5)
        np.testing.assert_array_equal(codes.index[i], index)
        np.testing.assert_allclose(codes.value[i], value, rtol=1e-9)


def test_repeated_atoms_and_dark_signals_are_coded_too(generator):
    atom = generator.normal(size=(1, 6))
    dictionary = np.vstack([atom, 2 * atom, np.zeros((1, 6))])
    signals = np.vstack([3 * atom, np.zeros((1, 6))])
    codes = sparse_codes(dictionary, signals, 3)
    np.testing.assert_allclose(codes.dense(3) @ dictionary, signals, atol=1e-12)
    np.testing.assert_array_equal(codes.value[1], 0)


def test_k_svd_finds_the_dictionary_that_made_the_signals(generator):
    made_of = np.linalg.qr(generator.normal(size=(20, 8)))[0].T
    signals = sparse_signals(generator, made_of, 400, 2)
    dictionary, codes = k_svd(signals, 8, 2, 40, generator)
    assert relative_error(signals, codes.dense(8) @ dictionary) < 1e-10
    # Each true atom is one that was found, but for its sign.
    np.testing.assert_allclose(np.abs(made_of @ dictionary.T).max(axis=1), 1, atol=1e-6)


def test_more_iterations_of_k_svd_fit_better(generator):
    signals = generator.normal(size=(200, 15))
    errors = []
    for iterations in (0, 1, 10):
        dictionary, codes = k_svd(signals, 20, 3, iterations, np.random.default_rng(1))
        errors.append(relative_error(signals, codes.dense(20) @ dictionary))
    assert errors[0] > errors[1] > errors[2]


def test_rotated_signals_keep_their_inner_products(generator):
    signals = generator.normal(size=(10, 50))
    signals[3] = signals[2]  # linearly dependent
    short = rotated(signals)
    assert short.shape == (10, 10)
    np.testing.assert_allclose(short @ short.T, signals @ signals.T, atol=1e-7)


def test_best_dictionary_is_least_squares(generator):
    codes, signals = generator.normal(size=(30, 4)), generator.normal(size=(30, 9))
    codes[:, 2] = 0
    expected = np.linalg.lstsq(codes, signals, rcond=None)[0]
    np.testing.assert_allclose(best_dictionary(codes, signals), expected, atol=1e-9)


def test_a_sparse_tensor_is_recovered(generator):
    rows, views, positions = 12, 6, 300
    vectors = np.linalg.qr(generator.normal(size=(rows, 5)))[0].T
    # Each slice has one light vector for each view; each position mixes two slices.
    view = Codes(generator.integers(0, 5, (views * 4, 1)), generator.uniform(1, 2, (views * 4, 1)))
    slices = SparseTensor(vectors, view, view, 4).slice_dictionary()
    signals = sparse_signals(generator, slices, positions, 2)
    found = fit_sparse_tensor(signals, rows, atoms=(5, 4), sparsity=(1, 2), iterations=60, seed=3)
    assert relative_error(signals, found.decode()) < 1e-9
    assert relative_error(signals, found.half().decode()) < 1e-5


def test_full_codes_recover_any_tensor(generator):
    signals = generator.normal(size=(7, 3 * 4))
    found = fit_sparse_tensor(signals, 3, atoms=(3, 7), sparsity=(3, 7), iterations=3)
    assert relative_error(signals, found.decode()) < 1e-9


@pytest.mark.parametrize("mode", ["views", "positions"])
def test_error_falls_with_the_number_of_coefficients(generator, mode):
    rows, views, positions = 10, 8, 250
    smooth = np.cumsum(generator.normal(size=(positions, rows, views)), axis=1)
    signals = smooth.reshape(positions, -1)
    errors = []
    for entries in (1, 2, 4, 8):
        sparsity = (entries, 8) if mode == "views" else (8, entries)
        found = fit_sparse_tensor(signals, rows, atoms=(16, 32), sparsity=sparsity, iterations=6)
        errors.append(relative_error(signals, found.half().decode()))
    assert errors == sorted(errors, reverse=True)


def test_a_part_of_the_positions_shapes_the_slices_and_all_are_coded(generator):
    dictionary = generator.normal(size=(4, 5 * 6))
    signals = sparse_signals(generator, dictionary, 200, 2)
    found = fit_sparse_tensor(
        signals, 5, atoms=(5, 4), sparsity=(5, 4), iterations=2, training=20, seed=2
    )
    assert found.position.index.shape == (200, 4)
    assert relative_error(signals, found.decode()) < 1e-9


def test_bytes_count_the_entries(generator):
    signals = generator.normal(size=(50, 9 * 4))
    found = fit_sparse_tensor(signals, 9, atoms=(12, 10), sparsity=(2, 3), iterations=1)
    stored = 2 * found.dictionary.size
    for codes in (found.view, found.position):
        stored += codes.index.astype(np.uint8).nbytes + codes.value.astype(np.float16).nbytes
    assert found.bytes == stored
    assert sparse_tensor_bytes(9, 4, 50, (300, 10), (2, 3)) == 2 * 9 * 300 + 4 * 10 * 2 * 4 + 450
