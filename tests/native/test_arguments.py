"""Every wrong argument gives one line that names it and says what was expected."""

import nacre_native
import numpy as np
import pytest


def message(call):
    with pytest.raises(ValueError) as error:
        call()
    text = str(error.value)
    assert "\n" not in text
    return text


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"ranks": (6, 3, 4)}, "ranks: expected 4 numbers, got 3"),
        ({"ranks": (19, 3, 4, 4)}, "ranks: expected 1 to 18 for mode 0, got 19"),
        ({"ranks": (6, 3, 0, 4)}, "ranks: expected 1 to 8 for mode 2, got 0"),
        ({"clusters": {}, "mixtures": {}}, "clusters: expected at least one clustered mode"),
        ({"clusters": {1: 0}}, "clusters: expected 1 to 24 for mode 1, got 0"),
        ({"clusters": {1: 25}}, "clusters: expected 1 to 24 for mode 1, got 25"),
        (  # of 18 rows: the colours of a light cannot be parted
            {"clusters": {0: 7}, "mixtures": {}, "global_modes": ()},
            "clusters: expected 1 to 6 for mode 0, got 7",
        ),
        (
            {"clusters": {4: 2}, "mixtures": {}, "directions": {4: np.zeros((1, 1))}},
            "clusters: expected distinct modes from 0 to 3, got 4",
        ),
        (
            {"clusters": {-1: 2}, "mixtures": {}, "directions": {-1: np.zeros((1, 1))}},
            "clusters: expected distinct modes from 0 to 3, got -1",
        ),
        ({"mixtures": {1: 5}}, "mixtures: expected 1 to 4 (the clusters) for mode 1, got 5"),
        ({"mixtures": {1: 0}}, "mixtures: expected 1 to 4 (the clusters) for mode 1, got 0"),
        ({"mixtures": {2: 1}}, "mixtures: mode 2 has no clusters"),
        ({"directions": {}}, "directions: expected those of mode 1"),
        ({"directions": {1: np.zeros((5, 3))}}, "directions: expected 24 rows for mode 1, got 5"),
        ({"directions": {1: np.zeros(24)}}, "directions: expected 2 dimensions, got 1"),
        ({"directions": {1: np.full((24, 3), np.nan)}}, "directions: expected finite numbers"),
        ({"search": "best"}, "search: expected auto, kcta, greedy or optimal, got best"),
        ({"iterations": -1}, "iterations: expected 0 or more, got -1"),
        ({"tolerance": -0.5}, "tolerance: expected 0 or more, got -0.5"),
        ({"threads": -2}, "threads: expected 0 (all) or more, got -2"),
        ({"start": {}}, "start: expected a model with core"),
    ],
)
def test_clustered(fit, changes, expected):
    assert message(lambda: fit(**changes)) == expected


@pytest.mark.parametrize("modes", [(1,), (0, 0), (4,), (-1,)])
def test_global_modes(fit, modes):
    assert message(lambda: fit(global_modes=modes)).startswith("global_modes: expected distinct")


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("core", lambda core: core[1:]),
        ("core", lambda core: core[:, :, :2]),
        ("core", lambda core: core[0]),
        ("basis", lambda basis: basis[:3]),
        ("basis", lambda basis: [basis[0][:0], *basis[1:]]),
        ("basis", lambda basis: [basis[0][:, 1:], *basis[1:]]),
        ("basis", lambda basis: [*basis[:2], basis[2][:1], basis[3]]),
        ("basis", lambda basis: [basis[0], basis[1][:, :, :1], *basis[2:]]),
        ("members", lambda members: {}),
        ("members", lambda members: {1: members[1][:-1]}),
        ("members", lambda members: {1: members[1][:, ::-1]}),
        ("members", lambda members: {1: members[1] + 1}),
        ("squared_norm", lambda norm: -1.0),
        ("squared_norm", lambda norm: np.nan),
    ],
)
def test_start(fit, name, change):
    start = fit(iterations=1)
    start[name] = change(start[name])
    text = message(lambda: fit(start=start))
    assert text.startswith("start") and "expected" in text


def test_start_with_global_bases_alone(fit):
    states = []
    fit(checkpoint=states.append)
    start = states[0]
    assert len(start["core"]) == 0 and start["errors"] == []
    for basis in (start["basis"][0][:0], start["basis"][0][..., 1:], np.zeros((1, 3, 1, 6))):
        bad = start | {"basis": [basis, *start["basis"][1:]]}
        assert message(lambda bad=bad: fit(start=bad)).startswith("start: expected a model")


@pytest.mark.parametrize(
    ("samples", "expected"),
    [
        (np.zeros((2, 3, 4, 5), np.float32), "samples: expected 5 axes"),
        (np.zeros((2, 3, 4, 5, 3)), "samples: expected float16 or float32, got float64"),
        (np.zeros((2, 3, 4, 5, 3), np.uint16), "samples: expected float16 or float32, got uint16"),
        (np.zeros((2, 3, 4, 5, 3), ">f4"), "samples: expected float16 or float32, got >f4"),
        (
            np.zeros((2, 3, 4, 5, 3), np.float32)[:, :, ::2],
            "samples: expected a C-contiguous array",
        ),
        (np.zeros((2, 0, 4, 5, 3), np.float32), "samples: expected at least one sample along view"),
    ],
)
def test_samples(samples, expected):
    assert message(lambda: nacre_native.fit_nsvd(samples, (1, 1, 1, 1))).startswith(expected)


def test_nsvd(samples):
    call = nacre_native.fit_nsvd
    assert message(lambda: call(samples, (6, 25, 4, 4))) == (
        "ranks: expected 1 to 24 for mode 1, got 25"
    )
    assert message(lambda: call(samples, (6, 3))) == "ranks: expected 4 numbers, got 2"
    assert message(lambda: call(samples, (6, 3, 4, 4), iterations=-1)).startswith("iterations:")


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize(
    ("value", "name"), [(np.nan, "NaN"), (np.inf, "infinity"), (-np.inf, "-infinity")]
)
@pytest.mark.parametrize("global_modes", [(), (0,), (2, 3)])
def test_bad_samples_are_named(samples, fit, dtype, value, name, global_modes):
    bad = samples.astype(dtype)
    bad[4, 20, 7, 6, 2] = np.nan
    bad[3, 17, 2, 5, 1] = value
    where = f"got {name} at light 3, view 17, y 2, x 5, channel 1"
    assert message(lambda: fit(samples=bad, global_modes=global_modes)).endswith(where)
    assert message(lambda: nacre_native.fit_nsvd(bad, (6, 3, 4, 4))).endswith(where)
    start = fit(samples=samples, global_modes=global_modes, iterations=0)
    again = {"samples": bad, "global_modes": global_modes, "start": start}
    assert message(lambda: fit(**again)).endswith(where)


def test_numbers_too_large_for_single_precision(samples):
    bad = samples.copy()
    bad[0, 1, 2, 3, 0] = 1e30
    text = message(lambda: nacre_native.fit_nsvd(bad, (6, 3, 4, 4)))
    assert text.endswith("got 1e+30 at light 0, view 1, y 2, x 3, channel 0")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"projections": np.zeros((5, 4))}, "projections: expected 3 dimensions, got 2"),
        ({"projections": "much"}, "projections: expected an array of numbers"),
        ({"projections": np.full((5, 4, 2), np.nan)}, "projections: expected finite numbers"),
        ({"gram": np.zeros((4, 4, 2, 3))}, "gram: expected (4, 4, 2, 2), got (4, 4, 2, 3)"),
        ({"gram": np.full((4, 4, 2, 2), np.inf)}, "gram: expected finite numbers"),
        ({"mixtures": 5}, "mixtures: expected 1 to 4 (the clusters), got 5"),
        ({"tied": 2}, "tied: expected a divisor of the 5 rows, got 2"),
        ({"tied": 0}, "tied: expected a divisor of the 5 rows, got 0"),
        ({"search": "best"}, "search: expected kcta, greedy or optimal, got best"),
        ({"search": "auto"}, "search: expected kcta, greedy or optimal, got auto"),
        (
            {"candidates": np.zeros((5, 1, 2), np.uint32), "tied": 5},
            "candidates: expected (1, any, 2), got (5, 1, 2)",
        ),
        (
            {"candidates": np.zeros((4, 1, 2), np.uint32)},
            "candidates: expected (5, any, 2), got (4, 1, 2)",
        ),
        (
            {"candidates": np.full((5, 1, 2), 9, np.uint32)},
            "candidates: expected clusters below 4, got 9 for row 0",
        ),
        (
            {"candidates": np.ones((5, 1, 2), np.uint32)},
            "candidates: expected distinct clusters, got 1 twice for row 0",
        ),
    ],
)
def test_search(changes, expected):
    arguments = {"projections": np.zeros((5, 4, 2)), "gram": np.zeros((4, 4, 2, 2)), "mixtures": 2}
    assert message(lambda: nacre_native.search_clusters(**(arguments | changes))) == expected


def test_core_gram():
    core, basis = np.zeros((3, 2, 2, 2)), [np.zeros((1, 5, 1, 2)), None, np.zeros((3, 6, 1, 2))]
    assert nacre_native.core_gram(core, basis).shape == (3, 3, 2, 2)
    assert (
        message(lambda: nacre_native.core_gram(core, basis[:2]))
        == "basis: expected 3 arrays, got 2"
    )
    assert message(lambda: nacre_native.core_gram(core, basis, clustered=3)).startswith(
        "clustered:"
    )
    basis[2] = np.zeros((2, 6, 1, 2))
    assert message(lambda: nacre_native.core_gram(core, basis)).startswith(
        "basis: expected (1 or 3,"
    )
