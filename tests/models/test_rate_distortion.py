"""The table of a model's truncations against truncated models."""

import itertools

import numpy as np
import pytest
from small_btf import make_model, write_dataset

from addon.models.fit import compress
from addon.models.rate_distortion import LOST, Regained, rank_choices, truncate, truncations

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
    for place in np.ndindex(table.own.shape):
        ranks = {
            mode: int(choices[at])
            for (mode, choices), at in zip(table.ranks.items(), place, strict=True)
        }
        small = truncate(model, ranks)
        assert small.ranks == ranks
        arrays = [small.core, *small.bases.values()]
        assert table.numbers_at(ranks) == sum(array.size for array in arrays)
        kept = np.sum(model.core**2, dtype=float) - table.shared[place] - table.own[place]
        assert kept == pytest.approx(np.sum(small.core**2, dtype=float), rel=1e-5)
        global_only = {
            mode: ranks[mode] if len(model.bases[mode]) == 1 else model.ranks[mode]
            for mode in ranks
        }
        rest = np.sum(model.core**2, dtype=float) - table.shared[place]
        kept = np.sum(truncate(model, global_only).core ** 2, dtype=float)
        assert rest == pytest.approx(kept, rel=1e-5)
    assert table.error_at(model.ranks) == pytest.approx(3.0)
    assert truncate(model, model.ranks).decode() == pytest.approx(model.decode())


def test_the_error_of_a_truncated_nsvd_is_the_decoded_one(tmp_path):
    dataset = write_dataset(tmp_path / "a.nacre", (6, 7, 9, 10, 3))
    ranks = {"light": 9, "view": 6, "y": 8, "x": 9}
    model = compress(dataset, "nsvd", ranks=ranks)
    energy = np.sum(np.square(dataset.samples, dtype=float))
    table = truncations(model, model.fit["errors"][-1] * energy)
    for ranks in ({"light": 4, "view": 3, "y": 8, "x": 4}, {"light": 9, "view": 1, "y": 2, "x": 9}):
        difference = truncate(model, ranks).decode().astype(float) - dataset.samples
        assert table.error_at(ranks) == pytest.approx(np.sum(difference**2), rel=1e-3)


@pytest.mark.parametrize("regained", [LOST, Regained(0.1, 0.3)])
def test_the_best_are_those_of_an_exhaustive_search(regained):
    table = truncations(make_model((6, 6, 9, 10, 2), (8, 5, 9, 6)), 0.5)
    every = [
        dict(zip(table.ranks, map(int, ranks), strict=True))
        for ranks in itertools.product(*table.ranks.values())
    ]
    middle = float(np.median(table.errors(regained)))
    room = int(np.median(table.numbers))

    def by_numbers(ranks):
        return table.numbers_at(ranks), table.error_at(ranks, regained)

    def by_error(ranks):
        return by_numbers(ranks)[::-1]

    good = sorted((r for r in every if by_error(r)[0] <= middle), key=by_numbers)
    small = sorted((r for r in every if by_numbers(r)[0] <= room), key=by_error)
    assert table.smallest(middle, regained, 1) == good[:1]
    assert table.closest(room, regained, 1) == small[:1]
    for first, found, key in (
        (good, table.smallest(middle, regained, 4), by_numbers),
        (small, table.closest(room, regained, 4), by_error),
    ):
        assert len(found) == len({ranks["x"] for ranks in found}) == 4
        assert found == sorted(found, key=key)
        assert all(ranks == next(r for r in first if r["x"] == ranks["x"]) for ranks in found)
    assert table.smallest(0.1, regained, 5) == table.closest(0, regained, 5) == []


def test_ranks_are_multiples_of_4_where_four_numbers_are_fetched_at_a_time():
    assert rank_choices("light", 18).tolist() == [1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 18]
    assert rank_choices("view", 2).tolist() == [1, 2]
    assert rank_choices("y", 7).tolist() == [1, 2, 3, 4, 5, 6, 7]
    assert rank_choices("x", 45).tolist() == [*range(1, 33), 36, 40, 44, 45]
    assert rank_choices("x", 1).tolist() == [1]


def test_the_slope_is_that_of_the_curve():
    table = truncations(make_model((6, 6, 9, 10, 2), (12, 6, 9, 10)), 100.0)
    assert 0.1 < table.slope({"light": 8, "view": 4, "y": 8, "x": 8}) < 2.0


def test_an_estimate_learns_from_a_fit():
    model = make_model((6, 6, 9, 10, 2), (8, 5, 9, 6), **CLUSTERED["kcta"])
    table = truncations(model, 20.0)
    ranks = {"light": 4, "view": 5, "y": 6, "x": 4}
    regained = Regained(0.1, 0.3)
    error = 0.9 * table.error_at(ranks, regained)
    learnt = table.learn(ranks, regained, error)
    assert table.error_at(ranks, learnt) == pytest.approx(error)
    assert learnt.own / learnt.shared == pytest.approx(3.0)
    assert table.learn(model.ranks, regained, error) == regained
