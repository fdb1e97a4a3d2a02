"""The table of a model's truncations against truncated models."""

import itertools

import numpy as np
import pytest
from small_btf import make_model, write_dataset

from addon.models.fit import compress
from addon.models.rate_distortion import rank_choices, truncate, truncations

CLUSTERED = {
    "nsvd": {},
    "kcta": {"clusters": {"view": 3}, "mixtures": {"view": 2}, "shared": ("light",)},
    "mkcta": {
        "clusters": {"light": 2, "view": 2},
        "mixtures": {"light": 1, "view": 2},
        "shared": ("y", "x"),
    },
}


@pytest.mark.parametrize("kind", CLUSTERED)
def test_every_entry_is_that_of_the_truncated_model(kind):
    model = make_model((6, 6, 9, 10, 2), (6, 5, 9, 6), **CLUSTERED[kind])
    table = truncations(model, 3.0)
    assert {mode: choices[-1] for mode, choices in table.ranks.items()} == model.ranks
    for mode in model.clusters:
        assert table.ranks[mode] == [model.ranks[mode]]
    for place in np.ndindex(table.kept.shape):
        ranks = {
            mode: int(choices[at])
            for (mode, choices), at in zip(table.ranks.items(), place, strict=True)
        }
        small = truncate(model, ranks)
        assert small.ranks == ranks
        arrays = [small.core, *small.bases.values()]
        assert table.numbers_at(ranks) == sum(array.size for array in arrays)
        assert table.kept[place] == pytest.approx(np.sum(small.core**2, dtype=float))
    assert table.error_at(model.ranks, 0.5) == 3.0
    assert truncate(model, model.ranks).decode() == pytest.approx(model.decode())


def test_the_error_of_a_truncated_nsvd_is_the_decoded_one(tmp_path):
    dataset = write_dataset(tmp_path / "a.nacre", (6, 7, 9, 10, 3))
    ranks = {"light": 9, "view": 6, "y": 8, "x": 9}
    model = compress(dataset, "nsvd", ranks=ranks)
    energy = np.sum(np.square(dataset.samples, dtype=float))
    table = truncations(model, model.fit["errors"][-1] * energy)
    for ranks in ({"light": 4, "view": 3, "y": 8, "x": 4}, {"light": 9, "view": 1, "y": 2, "x": 9}):
        difference = truncate(model, ranks).decode().astype(float) - dataset.samples
        assert table.error_at(ranks, 0.0) == pytest.approx(np.sum(difference**2), rel=1e-3)


@pytest.mark.parametrize("regained", [0.0, 0.3])
def test_the_best_are_those_of_an_exhaustive_search(regained):
    table = truncations(make_model((6, 6, 9, 10, 2), (8, 5, 9, 6)), 0.5)
    every = [
        dict(zip(table.ranks, map(int, ranks), strict=True))
        for ranks in itertools.product(*table.ranks.values())
    ]
    middle = float(np.median(table.errors(regained)))
    enough = [ranks for ranks in every if table.error_at(ranks, regained) <= middle]
    by_numbers = sorted(enough, key=lambda r: (table.numbers_at(r), table.error_at(r, regained)))
    assert table.smallest(middle, regained, 5) == by_numbers[:5]
    room = int(np.median(table.numbers))
    small = [ranks for ranks in every if table.numbers_at(ranks) <= room]
    by_error = sorted(small, key=lambda r: (table.error_at(r, regained), table.numbers_at(r)))
    assert table.closest(room, regained, 5) == by_error[:5]
    assert table.smallest(0.0, regained, 5) == table.closest(0, regained, 5) == []


def test_ranks_are_multiples_of_4():
    assert rank_choices(18).tolist() == [1, 2, 3, 4, 8, 12, 16, 18]
    assert rank_choices(2).tolist() == [1, 2]
    assert rank_choices(1).tolist() == [1]


def test_the_slope_is_that_of_the_curve():
    table = truncations(make_model((6, 6, 9, 10, 2), (12, 6, 9, 10)), 100.0)
    assert 0.1 < table.slope({"light": 8, "view": 4, "y": 8, "x": 8}) < 2.0
