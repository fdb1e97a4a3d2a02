"""Fits in the coordinates of an N-SVD are fits of the dataset."""

import numpy as np
import pytest
from small_btf import make_samples, write_dataset

from addon.models.fit import compress, mode_sizes
from addon.models.reduced import first_ranks, larger_ranks, reduce_dataset

SHAPE = (6, 7, 9, 10, 3)
SETTINGS = {
    "nsvd": {"ranks": {"light": 5, "view": 3, "y": 4, "x": 5}},
    "kcta": {
        "ranks": {"light": 5, "view": 2, "y": 4, "x": 5},
        "clusters": {"view": 3},
        "mixtures": {"view": 2},
    },
    "mkcta": {
        "ranks": {"light": 3, "view": 2, "y": 4, "x": 5},
        "clusters": {"light": 2, "view": 2},
        "mixtures": {"light": 2, "view": 1},
    },
}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return write_dataset(tmp_path_factory.mktemp("reduced") / "a.nacre", SHAPE)


def squared_error(model, dataset):
    return np.sum((model.decode().astype(float) - dataset.samples) ** 2)


@pytest.mark.parametrize("method", SETTINGS)
@pytest.mark.parametrize("less", [0, 1], ids=["full", "less"])
def test_a_fit_to_the_reduced_dataset_is_one_to_the_dataset(method, less, dataset, tmp_path):
    clustered = tuple(SETTINGS[method].get("clusters", {}))
    ranks = {
        mode: rows if mode in clustered else rows - 2 * less
        for mode, rows in mode_sizes(dataset).items()
    }
    reduced = reduce_dataset(dataset, ranks, clustered, scratch=tmp_path)
    energy = np.sum(np.square(dataset.samples, dtype=float))
    assert reduced.squared_norm == pytest.approx(energy)
    assert reduced.ranks == ranks
    assert squared_error(reduced.nsvd, dataset) == pytest.approx(
        reduced.lost, rel=1e-3, abs=1e-6 * energy
    )
    assert (reduced.lost > 1e-3) == bool(less)
    model = reduced.restore(compress(reduced.dataset, method, **SETTINGS[method]))
    assert model.shape == SHAPE
    assert model.dataset["light"] == dataset.light.tolist()
    error = squared_error(model, dataset) / energy
    assert model.fit["errors"][-1] == pytest.approx(error, rel=1e-3)
    direct = compress(dataset, method, **SETTINGS[method]).fit["errors"][-1]
    assert error == pytest.approx(direct, rel=0.2 if less else 0.02)


def test_ranks_begin_as_memory_allows(tmp_path):
    dataset = write_dataset(tmp_path / "a.nacre", (40, 5, 16, 32, 3))
    assert first_ranks(dataset, ()) == {"light": 64, "view": 5, "y": 16, "x": 32}
    assert first_ranks(dataset, ("light",)) == {"light": 120, "view": 5, "y": 16, "x": 32}
    bounded = first_ranks(dataset, (), 64 * 5 * 16 * 32 * 8)
    assert bounded == {"light": 64, "view": 5, "y": 8, "x": 16}


def test_ranks_grow_where_they_fall_short(tmp_path):
    samples = make_samples((8, 7, 12, 12, 3), noise=0.0)
    samples += 0.1 * np.cos(np.arange(12) * np.arange(12)[:, None])[..., None]  # of high rank in x
    dataset = write_dataset(tmp_path / "a.nacre", samples.shape, samples)
    ranks = {"light": 24, "view": 7, "y": 12, "x": 3}
    reduced = reduce_dataset(dataset, ranks, (), scratch=tmp_path)
    usual = {"light": 4, "view": 4, "y": 4, "x": 2}
    assert larger_ranks(reduced, usual, 100.0 * reduced.lost) == ranks
    assert larger_ranks(reduced, usual, reduced.lost) == {**ranks, "x": 6}
    assert larger_ranks(reduced, {**usual, "x": 3}, 100.0 * reduced.lost) == {**ranks, "x": 6}
    whole = reduce_dataset(dataset, {**ranks, "x": 12}, (), scratch=tmp_path)
    assert larger_ranks(whole, {**usual, "x": 12}, 0.0) == whole.ranks
