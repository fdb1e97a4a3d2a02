"""K-CTA and CTA through the bindings, and against the dense reference."""

import nacre_native
import numpy as np
import pytest

from . import reference
from .models import assert_same, check_bases, check_errors, check_shapes


def test_shapes_and_members(samples, fit):
    model = fit(ranks=(6, 3, 4, 5))
    assert [b.shape for b in model["basis"]] == [
        (1, 18, 1, 6),
        (1, 24, 2, 3),
        (4, 8, 1, 4),
        (4, 7, 1, 5),
    ]
    check_shapes(model, samples, (6, 3, 4, 5), {1: 4}, {1: 2}, (0,))


@pytest.mark.parametrize("global_modes", [(), (0,), (2, 3), (0, 2, 3)])
@pytest.mark.parametrize("mixtures", [1, 2, 4])
def test_error_is_that_of_the_reconstruction(samples, fit, mixtures, global_modes):
    model = fit(mixtures={1: mixtures}, global_modes=global_modes, iterations=4)
    check_errors(model, samples, {1: 4})


def test_bases_are_orthonormal(fit):
    model = fit(ranks=(6, 8, 4, 4))  # 8 columns, some clusters have fewer members
    check_bases(model, {1: 4})
    assert np.bincount(model["members"][1].ravel()).min() < 8


@pytest.mark.parametrize("mixtures", [1, 2, 3])
def test_follows_the_dense_reference(samples, fit, mixtures):
    """Algorithm 1, iteration by iteration; with one mixture cluster that is CTA."""
    seeds = fit(mixtures={}, iterations=0)["members"][1][:, 0]
    model = fit(mixtures={1: mixtures}, iterations=5, tolerance=0)
    errors, members = reference.kcta(samples, (6, 3, 4, 4), seeds, mixtures, 5)
    assert model["errors"] == pytest.approx(errors, rel=1e-3)
    np.testing.assert_array_equal(model["members"][1], members)


@pytest.mark.parametrize("search", ["kcta", "greedy", "optimal"])
def test_more_mixtures_are_better(fit, search):
    errors = [fit(mixtures={1: k}, search=search)["errors"][-1] for k in (1, 2, 3)]
    assert errors[0] > errors[1] > errors[2]


def test_searches(fit):
    """Its own is what K-CTA takes if none is named; with one mixture cluster they are all one."""
    assert_same(fit(mixtures={1: 3}), fit(mixtures={1: 3}, search="kcta"))
    different = [fit(mixtures={1: 3}, search=s)["errors"] for s in ("kcta", "greedy", "optimal")]
    assert different[0] != different[1] != different[2] != different[0]
    for search in ("kcta", "greedy", "optimal"):
        assert_same(fit(mixtures={}), fit(mixtures={1: 1}, search=search))


def test_one_cluster_without_global_bases_is_nsvd(samples, fit):
    model = fit(clusters={1: 1}, mixtures={}, global_modes=(), iterations=40, tolerance=1e-7)
    nsvd = nacre_native.fit_nsvd(samples, (6, 3, 4, 4), iterations=40, tolerance=1e-7)
    assert model["errors"][-1] == pytest.approx(nsvd["errors"][-1], rel=1e-3)


def test_same_bits_for_any_threads(fit):
    first = fit(threads=1)
    assert_same(first, fit(threads=2))
    assert_same(first, fit(threads=3))
    assert_same(first, fit())


def test_seeds(fit):
    assert_same(fit(seed=7), fit(seed=7))
    firsts = [fit(seed=s, mixtures={}, iterations=0)["members"][1][:, 0] for s in range(8)]
    assert len({tuple(seeds) for seeds in firsts}) > 1


def test_half_and_float_agree(samples, fit):
    half = samples.astype(np.float16)
    assert_same(fit(samples=half), fit(samples=half.astype(np.float32)))


@pytest.mark.parametrize("mode", [2, 3])
def test_other_clustered_modes(samples, fit, mode):
    arguments = {"clusters": {mode: 3}, "mixtures": {mode: 2}}
    model = fit(**arguments)
    check_shapes(model, samples, (6, 3, 4, 4), *arguments.values(), (0,))
    check_errors(model, samples, {mode: 3})
    assert model["errors"][-1] < model["errors"][0]


@pytest.mark.parametrize("value", [0.0, 0.25])
@pytest.mark.parametrize("mixtures", [1, 3])
def test_constant_tensors_leave_no_cluster_empty(fit, value, mixtures):
    samples = np.full((3, 24, 5, 6, 3), value, np.float16)
    arguments = {"clusters": {1: 5}, "mixtures": {1: mixtures}}
    model = fit(samples=samples, ranks=(2, 2, 2, 2), **arguments)
    np.testing.assert_allclose(reference.reconstruct(model), value, atol=1e-5)
    check_shapes(model, samples, (2, 2, 2, 2), *arguments.values(), (0,))


def test_extreme_parameters(samples, fit):
    full = fit(ranks=(18, 24, 8, 7), clusters={1: 24}, mixtures={1: 3})  # all as the modes
    assert reference.relative_error(samples, full) < 1e-8
    all_clusters = fit(mixtures={1: 4})
    np.testing.assert_array_equal(all_clusters["members"][1], np.tile(np.arange(4), (24, 1)))
    thin = np.random.default_rng(1).random((1, 24, 1, 3, 1), np.float32)
    assert fit(samples=thin, ranks=(1, 2, 1, 2))["core"].shape == (4, 1, 2, 1, 2)


def test_first_guess_alone_fills_its_rows(fit):
    model = fit(mixtures={1: 3}, iterations=0)
    assert model["iterations"] == 0 and len(model["errors"]) == 1
    assert np.all(np.diff(model["members"][1].astype(int), axis=1) > 0)
    used = np.any(model["basis"][1][0] != 0, axis=-1)
    np.testing.assert_array_equal(used.sum(1), 1)
