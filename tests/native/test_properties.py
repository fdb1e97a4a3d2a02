"""What holds for every fit, on random shapes and settings."""

import nacre_native
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from . import reference
from .conftest import make_samples, places
from .models import assert_same, check_bases, check_errors, check_shapes

stable = settings(max_examples=25, deadline=None, derandomize=True, database=None)


def samples_of(kind, shape, seed):
    """Some that all subtensors have a share in, and degenerate ones."""
    rng = np.random.default_rng(seed)
    if kind == "noise":
        return rng.standard_normal(shape).astype(np.float32)
    if kind == "material":
        return make_samples(*shape, seed=seed)
    if kind == "mostly dark":
        return rng.random(shape, np.float32) * (rng.random((*shape[:2], 1, 1, 1)) < 0.3)
    if kind == "twins":
        whole = rng.random(shape, np.float32)
        return np.ascontiguousarray(whole[rng.integers(0, shape[0], shape[0])])
    return np.full(shape, {"constant": 0.3, "zero": 0.0}[kind], np.float32)


@st.composite
def problems(draw, kinds=("noise", "material"), least=2, largest=6, modes=None, rank=None):
    """Samples and the arguments of a fit."""
    sizes = [draw(st.integers(least, largest)) for _ in range(4)]
    shape = (*sizes, draw(st.sampled_from([1, 3])))
    samples = samples_of(draw(st.sampled_from(kinds)), shape, draw(st.integers(0, 99)))
    rows = (shape[0] * shape[4], *shape[1:4])
    ranks = tuple(draw(st.integers(1, min(rank or n, n))) for n in rows)
    if modes is None:
        modes = sorted(draw(st.sets(st.integers(0, 3), min_size=1)))
    # All ranks and clusters in all modes would make the largest fits take seconds.
    most = {1: 9, 2: 4, 3: 2, 4: 2}[len(modes)]
    ranks = tuple(min(r, 4) if mode in modes and most < 9 else r for mode, r in enumerate(ranks))
    clusters = {mode: draw(st.integers(1, min(most, shape[mode]))) for mode in modes}
    mixtures = {mode: draw(st.integers(1, min(3, clusters[mode]))) for mode in modes}
    others = [mode for mode in range(4) if mode not in modes]
    arguments = {
        "ranks": ranks,
        "clusters": clusters,
        "mixtures": mixtures,
        "global_modes": tuple(mode for mode in others if draw(st.booleans())),
        "search": draw(st.sampled_from(["auto", "kcta", "greedy", "optimal"])),
        "directions": {mode: places(samples, mode) for mode in modes},
        "seed": draw(st.integers(0, 9)),
        "iterations": draw(st.integers(0, 8)),
    }
    return samples, arguments


def fit(samples, arguments, **changes):
    arguments = arguments | changes
    return nacre_native.fit_clustered(samples, arguments.pop("ranks"), **arguments)


def check_model(samples, arguments, model):
    names = ("ranks", "clusters", "mixtures", "global_modes")
    check_shapes(model, samples, *(arguments[name] for name in names))
    check_bases(model, arguments["clusters"])
    check_errors(model, samples, arguments["clusters"])


@stable
@given(problems())
def test_models_are_what_they_should_be_with_the_same_bits_for_any_threads(problem):
    samples, arguments = problem
    model = fit(samples, arguments, threads=1)
    check_model(samples, arguments, model)
    for threads in (2, 3):
        assert_same(fit(samples, arguments, threads=threads), model)


@stable
@given(problems(kinds=("noise", "mostly dark", "twins", "constant", "zero"), least=1, largest=4))
def test_degenerate_samples_and_shapes(problem):
    samples, arguments = problem
    check_model(samples, arguments, fit(samples, arguments))


@stable
@given(problems(kinds=("noise", "mostly dark"), least=1, largest=5))
def test_full_ranks_leave_nothing(problem):
    """Ranks equal to the modes. (Those of clusters with fewer members are as many as these.)"""
    samples, arguments = problem
    light, view, y, x, channel = samples.shape
    arguments["ranks"] = (light * channel, view, y, x)
    model = fit(samples, arguments)
    check_model(samples, arguments, model)
    assert model["errors"][-1] < 1e-6  # the energy that single precision sums lose


@stable
@given(problems(), st.integers(-9, 9))
def test_scaling_scales_the_cores_alone(problem, power):
    """A power of two does not change a bit of anything else."""
    samples, arguments = problem
    scale = np.float32(2.0**power)
    first, second = fit(samples, arguments), fit(samples * scale, arguments)
    first["core"] = first["core"] * scale
    first["squared_norm"] *= 4.0**power
    assert_same(first, second)


@stable
@given(problems(rank=3), st.data())
def test_order_of_the_items_does_not_matter(problem, data):
    """From the same first membership; sums are then taken in another order."""
    samples, arguments = problem
    arguments |= {"iterations": 1, "tolerance": 0}
    states = []
    model = fit(samples, arguments, checkpoint=states.append)
    start = states[-1]
    mode = data.draw(st.sampled_from(sorted(arguments["clusters"])))
    order = np.array(data.draw(st.permutations(range(samples.shape[mode]))))
    rows = order
    if mode == 0:
        channels = samples.shape[4]
        rows = (order[:, None] * channels + np.arange(channels)).ravel()
    start["members"][mode] = start["members"][mode][order]
    start["basis"][mode] = start["basis"][mode][:, rows]
    moved = fit(np.ascontiguousarray(np.take(samples, order, axis=mode)), arguments, start=start)
    # An iteration that changes nothing may, by rounding, count as a rise and be taken back.
    assert moved["errors"][-1] == pytest.approx(model["errors"][-1], rel=1e-4, abs=1e-7)
    for clustered in arguments["clusters"]:
        expected = model["members"][clustered]
        expected = expected[order] if clustered == mode else expected
        np.testing.assert_array_equal(moved["members"][clustered], expected)


@stable
@given(problems())
def test_with_one_mixture_cluster_every_search_is_that_of_cta(problem):
    samples, arguments = problem
    arguments |= {"mixtures": dict.fromkeys(arguments["clusters"], 1)}
    first = fit(samples, arguments, search="kcta")
    for search in ("greedy", "optimal", "auto"):
        assert_same(fit(samples, arguments, search=search), first)


@stable
@given(problems(kinds=("material",), least=3, largest=6, rank=3))
def test_one_cluster_without_global_bases_is_nsvd(problem):
    samples, arguments = problem
    ones = dict.fromkeys(arguments["clusters"], 1)
    arguments |= {"clusters": ones, "mixtures": ones, "global_modes": ()}
    model = fit(samples, arguments, iterations=60, tolerance=1e-7)
    nsvd = nacre_native.fit_nsvd(samples, arguments["ranks"], iterations=60, tolerance=1e-7)
    assert model["errors"][-1] == pytest.approx(nsvd["errors"][-1], rel=1e-2)
    first, second = reference.reconstruct(model, ones), reference.reconstruct(nsvd)
    assert np.sum((first - second) ** 2) <= 0.05 * nsvd["squared_norm"] * nsvd["errors"][-1] + 1e-9


@stable
@given(problems(least=1), st.data())
def test_bad_samples_are_named(problem, data):
    samples, arguments = problem
    index = tuple(data.draw(st.integers(0, n - 1)) for n in samples.shape)
    name, value = data.draw(
        st.sampled_from([("NaN", np.nan), ("infinity", np.inf), ("-infinity", -np.inf)])
    )
    samples[index] = value
    with pytest.raises(ValueError) as error:
        fit(samples, arguments)
    where = "light {}, view {}, y {}, x {}, channel {}".format(*index)
    assert str(error.value).endswith(f"got {name} at {where}")
