"""MK-CTA through the bindings, against the dense reference and the add-on's decoder."""

import nacre_native
import numpy as np
import pytest

from addon.models.clustered_tucker import MODES, ClusteredTucker

from . import reference, reference_mkcta
from .conftest import make_samples
from .models import assert_same, check_bases, check_errors, check_shapes

CASES = {
    "light and view": ((3, 3, 4, 4), {0: 3, 1: 4}, {0: 2, 1: 2}, (2, 3)),
    "hard": ((3, 3, 4, 4), {0: 3, 1: 4}, {0: 1, 1: 1}, (2, 3)),
    "greedy": ((3, 2, 4, 4), {0: 3, 1: 5}, {0: 2, 1: 3}, (3,)),
    "view and y": ((6, 3, 2, 4), {1: 4, 2: 3}, {1: 2, 2: 1}, (0,)),
    "light and x": ((2, 6, 4, 2), {0: 2, 3: 3}, {0: 1, 3: 2}, ()),
    "three modes": ((3, 2, 2, 4), {0: 2, 1: 3, 2: 2}, {0: 1, 1: 2, 2: 2}, (3,)),
    "all modes": ((2, 2, 2, 2), {0: 2, 1: 3, 2: 2, 3: 2}, {0: 2, 1: 2, 2: 1, 3: 1}, ()),
}


@pytest.mark.parametrize("case", CASES)
def test_models(samples, fit, case):
    ranks, clusters, mixtures, global_modes = CASES[case]
    model = fit(
        ranks=ranks, clusters=clusters, mixtures=mixtures, global_modes=global_modes, iterations=6
    )
    check_shapes(model, samples, *CASES[case])
    check_bases(model, clusters)
    check_errors(model, samples, clusters)
    assert model["errors"][-1] < model["errors"][0]

    names = [MODES[mode] for mode in clusters]
    decoded = ClusteredTucker(
        core=model["core"],
        bases=dict(zip(MODES, model["basis"], strict=True)),
        members=dict(zip(names, model["members"].values(), strict=True)),
        clusters=dict(zip(names, clusters.values(), strict=True)),
        dataset={"channels": ["R", "G", "B"]},
    ).decode()
    expected = reference.reconstruct(model, clusters)
    np.testing.assert_allclose(reference.tensor_of(decoded), expected, atol=1e-5)


@pytest.mark.parametrize(
    ("ranks", "clusters", "mixtures", "search", "global_mode"),
    [
        ((3, 3, 4, 4), {0: 2, 1: 4}, {0: 1, 1: 2}, "auto", 2),
        ((3, 3, 4, 4), {0: 3, 1: 4}, {0: 2, 1: 2}, "auto", None),
        ((2, 3, 4, 4), {0: 3, 1: 5}, {0: 2, 1: 3}, "auto", 3),  # greedy in one of the modes
        ((3, 2, 4, 4), {0: 3, 1: 4}, {0: 2, 1: 2}, "greedy", 2),
        ((6, 2, 2, 4), {1: 4, 2: 3}, {1: 2, 2: 1}, "optimal", 0),
        ((2, 2, 2, 3), {0: 2, 1: 3, 2: 2}, {0: 1, 1: 2, 2: 1}, "auto", None),
    ],
)
def test_follows_the_dense_reference(samples, fit, ranks, clusters, mixtures, search, global_mode):
    """Algorithms 1 to 3, iteration by iteration."""
    arguments = {
        "ranks": ranks,
        "clusters": clusters,
        "mixtures": mixtures,
        "global_modes": () if global_mode is None else (global_mode,),
        "search": search,
        "tolerance": 0,
    }
    states = []
    model = fit(**arguments, iterations=7, checkpoint=states.append)
    states = [state for state in states if state["errors"]]
    seeds = {mode: members[:, 0] for mode, members in states[0]["members"].items()}
    errors, history = reference_mkcta.mkcta(samples, ranks, seeds, mixtures, 7, search, global_mode)
    assert model["errors"] == pytest.approx(errors, rel=1e-3)
    for iteration, members in enumerate(history):
        found = next((s for s in states if len(s["errors"]) == iteration + 1), model)
        for mode in clusters:
            np.testing.assert_array_equal(found["members"][mode], members[mode])
    assert len(history) > 5 and len(history[-1][1][0]) == mixtures[1]


def test_an_empty_cluster_takes_over_half_of_the_worst_one(samples, fit):
    """Lights without light: one cluster has nothing, and its lights may go to any other. It comes
    back as half of another, and so it must count in the other modes' clustering stage."""
    dark = make_samples(lights=9)
    arguments = {
        "ranks": (2, 2, 4, 4),
        "clusters": {0: 3, 1: 4},
        "mixtures": {0: 1, 1: 2},
        "global_modes": (2,),
        "samples": dark,
    }
    seeds = fit(**arguments, iterations=0)["members"]
    dark[seeds[0][:, 0] == 2] = 0
    states = []
    model = fit(**arguments, iterations=4, tolerance=0, checkpoint=states.append)
    first = {mode: members[:, 0] for mode, members in states[1]["members"].items()}
    np.testing.assert_array_equal(first[0], seeds[0][:, 0])
    assert np.all(states[1]["core"][8:] == 0)  # the first guess of cluster 2
    errors, history = reference_mkcta.mkcta(
        dark, arguments["ranks"], first, arguments["mixtures"], 4, global_mode=2
    )
    assert model["errors"] == pytest.approx(errors, rel=1e-3)
    assert set(np.ravel(history[1][0])) == {0, 1, 2}
    for mode in (0, 1):
        np.testing.assert_array_equal(model["members"][mode], history[-1][mode])


def test_colours_of_a_light_share_its_clusters(samples, fit_several):
    """The bases have a row for each colour, the members one for each light."""
    model = fit_several()
    assert model["members"][0].shape == (6, 2) and model["basis"][0].shape == (4, 18, 2, 3)
    rows = model["basis"][0].reshape(4, 6, 3, 2, 3)
    assert not np.allclose(rows[:, :, 0], rows[:, :, 1])  # with numbers of their own
    # The search takes the sum over the colours: a colour that is zero everywhere changes nothing.
    grey = np.repeat(samples[..., :1], 3, axis=-1)
    one_colour = grey * np.float32([1, 0, 0])
    hard = {"mixtures": {}, "iterations": 2, "tolerance": 0, "global_modes": ()}
    first, second = (fit_several(samples=s, **hard) for s in (grey, one_colour))
    np.testing.assert_array_equal(first["members"][0], second["members"][0])
    assert first["errors"] == pytest.approx(second["errors"], rel=1e-3)


def test_more_clusters_and_mixtures_are_better(fit_several):
    errors = [fit_several(mixtures={0: k, 1: k})["errors"][-1] for k in (1, 2, 3)]
    assert errors[0] > errors[1] > errors[2]
    errors = [fit_several(clusters={0: 3, 1: c})["errors"][-1] for c in (2, 4, 6)]
    assert errors[0] > errors[1] > errors[2]


def test_searches(fit_several):
    """Without a name: optimal below three mixture clusters, else greedy, mode by mode."""
    two, three = {0: 2, 1: 2}, {0: 2, 1: 3}
    assert_same(fit_several(mixtures=two), fit_several(mixtures=two, search="optimal"))
    five = {"clusters": {0: 5, 1: 5}}
    fits = [
        fit_several(mixtures=three, search=name, **five) for name in ("auto", "kcta", "optimal")
    ]
    assert len({tuple(model["errors"]) for model in fits}) == 3
    for search in ("kcta", "greedy", "optimal"):
        assert_same(fit_several(mixtures={}), fit_several(mixtures={}, search=search))


def test_one_cluster_in_each_mode_without_global_bases_is_nsvd(samples, fit_several):
    model = fit_several(
        ranks=(6, 3, 4, 4),
        clusters={0: 1, 1: 1},
        mixtures={},
        global_modes=(),
        iterations=40,
        tolerance=1e-7,
    )
    nsvd = nacre_native.fit_nsvd(samples, (6, 3, 4, 4), iterations=40, tolerance=1e-7)
    assert model["errors"][-1] == pytest.approx(nsvd["errors"][-1], rel=1e-3)


@pytest.mark.parametrize("case", CASES)
def test_same_bits_for_any_threads(fit, case):
    ranks, clusters, mixtures, global_modes = CASES[case]
    first, *others = (
        fit(
            ranks=ranks,
            clusters=clusters,
            mixtures=mixtures,
            global_modes=global_modes,
            iterations=6,
            threads=threads,
        )
        for threads in (1, 2, 3)
    )
    for other in others:
        assert_same(first, other)


@pytest.mark.parametrize("value", [0.0, 0.25])
def test_constant_tensors_leave_no_cluster_empty(fit, value):
    samples = np.full((4, 9, 5, 6, 3), value, np.float16)
    for mixtures in ({0: 1, 1: 1}, {0: 2, 1: 3}):
        arguments = {"clusters": {0: 3, 1: 5}, "mixtures": mixtures, "global_modes": (2, 3)}
        model = fit(samples=samples, ranks=(2, 2, 2, 2), **arguments)
        np.testing.assert_allclose(
            reference.reconstruct(model, arguments["clusters"]), value, atol=1e-5
        )
        check_shapes(model, samples, (2, 2, 2, 2), *arguments.values())
