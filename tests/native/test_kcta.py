"""K-CTA and CTA through the bindings, and against the dense reference."""

import nacre_native
import numpy as np
import pytest

from . import reference


def assert_same(first, second):
    np.testing.assert_array_equal(first["core"], second["core"])
    np.testing.assert_array_equal(first["members"], second["members"])
    assert first["errors"] == second["errors"]
    for a, b in zip(first["basis"], second["basis"], strict=True):
        np.testing.assert_array_equal(a, b)


def test_shapes_and_members(fit):
    model = fit(ranks=(6, 3, 4, 5))
    assert model["core"].shape == (4, 6, 3, 4, 5)
    assert [b.shape for b in model["basis"]] == [
        (1, 18, 1, 6),
        (1, 24, 2, 3),
        (4, 8, 1, 4),
        (4, 7, 1, 5),
    ]
    members = model["members"]
    assert members.shape == (24, 2) and members.dtype == np.uint32
    assert np.all(members[:, 0] < members[:, 1]) and set(members.ravel()) == set(range(4))
    assert np.all(np.diff(model["errors"]) <= 0)
    assert model["iterations"] >= len(model["errors"]) - 1


@pytest.mark.parametrize("global_modes", [(), (0,), (2, 3), (0, 2, 3)])
@pytest.mark.parametrize("mixtures", [1, 2, 4])
def test_error_is_that_of_the_reconstruction(samples, fit, mixtures, global_modes):
    model = fit(mixtures=mixtures, global_modes=global_modes, iterations=4)
    assert reference.relative_error(samples, model) == pytest.approx(model["errors"][-1], rel=1e-3)


def test_bases_are_orthonormal(fit):
    model = fit(ranks=(6, 8, 4, 4))  # 8 columns, some clusters have fewer members
    mixing = np.zeros((4, 24, 8))
    for i, row in enumerate(model["members"]):
        mixing[row, i] = model["basis"][1][0, i]
    for c in range(4):
        members = np.sum(model["members"] == c)
        expected = np.diag((np.arange(8) < members).astype(float))
        np.testing.assert_allclose(mixing[c].T @ mixing[c], expected, atol=1e-5)
    for n in (0, 2, 3):
        for u in model["basis"][n][:, :, 0].astype(np.float64):
            np.testing.assert_allclose(u.T @ u, np.eye(u.shape[1]), atol=1e-5)


@pytest.mark.parametrize("mixtures", [1, 2, 3])
def test_follows_the_dense_reference(samples, fit, mixtures):
    """Algorithm 1, iteration by iteration; with one mixture cluster that is CTA."""
    seeds = fit(mixtures=1, iterations=0)["members"][:, 0]
    model = fit(mixtures=mixtures, iterations=5, tolerance=0)
    errors, members = reference.kcta(samples, (6, 3, 4, 4), seeds, mixtures, 5)
    assert model["errors"] == pytest.approx(errors, rel=1e-3)
    np.testing.assert_array_equal(model["members"], members)


def test_more_mixtures_are_better(fit):
    errors = [fit(mixtures=k)["errors"][-1] for k in (1, 2, 3)]
    assert errors[0] > errors[1] > errors[2]


def test_one_cluster_without_global_bases_is_nsvd(samples, fit):
    model = fit(clusters=1, mixtures=1, global_modes=(), iterations=40, tolerance=1e-7)
    error = nacre_native.fit_nsvd(samples, (6, 3, 4, 4), iterations=40, tolerance=1e-7)["errors"][
        -1
    ]
    assert model["errors"][-1] == pytest.approx(error, rel=1e-3)


def test_same_bits_for_any_threads(fit):
    first = fit(threads=1)
    assert_same(first, fit(threads=2))
    assert_same(first, fit(threads=3))
    assert_same(first, fit())


def test_seeds(fit):
    assert_same(fit(seed=7), fit(seed=7))
    seeds = {tuple(fit(seed=s, mixtures=1, iterations=0)["members"][:, 0]) for s in range(8)}
    assert len(seeds) > 1


def test_half_and_float_agree(samples, fit):
    half = samples.astype(np.float16)
    assert_same(fit(samples=half), fit(samples=half.astype(np.float32)))


def test_scaling_scales_the_cores_alone(samples, fit):
    first, second = fit(iterations=3), fit(samples=samples * np.float32(4), iterations=3)
    np.testing.assert_array_equal(first["members"], second["members"])
    np.testing.assert_allclose(second["errors"], first["errors"], rtol=1e-3)


@pytest.mark.parametrize("mode", [2, 3])
def test_other_clustered_modes(samples, fit, mode):
    count = samples.shape[mode]
    model = fit(clustered=mode, clusters=3, directions=np.arange(count)[:, None])
    assert model["basis"][mode].shape == (1, count, 2, 4)
    assert model["members"].shape == (count, 2)
    assert np.all(np.diff(model["errors"]) <= 0) and model["errors"][-1] < model["errors"][0]


@pytest.mark.parametrize("value", [0.0, 0.25])
@pytest.mark.parametrize("mixtures", [1, 3])
def test_constant_tensors_leave_no_cluster_empty(fit, value, mixtures):
    samples = np.full((3, 24, 5, 6, 3), value, np.float16)
    model = fit(samples=samples, ranks=(2, 2, 2, 2), clusters=5, mixtures=mixtures)
    np.testing.assert_allclose(reference.reconstruct(model), value, atol=1e-5)
    assert set(model["members"].ravel()) == set(range(5))
    assert all(np.all(np.isfinite(b)) for b in model["basis"])


def test_extreme_parameters(samples, fit):
    full = fit(ranks=(18, 24, 8, 7), clusters=24, mixtures=3)  # ranks and clusters as the modes
    assert reference.relative_error(samples, full) < 1e-8
    all_clusters = fit(mixtures=4)
    np.testing.assert_array_equal(all_clusters["members"], np.tile(np.arange(4), (24, 1)))
    thin = np.random.default_rng(1).random((1, 24, 1, 3, 1), np.float32)
    assert fit(samples=thin, ranks=(1, 2, 1, 2))["core"].shape == (4, 1, 2, 1, 2)


def test_first_guess_alone_fills_its_rows(fit):
    model = fit(mixtures=3, iterations=0)
    assert model["iterations"] == 0 and len(model["errors"]) == 1
    assert np.all(np.diff(model["members"].astype(int), axis=1) > 0)
    used = np.any(model["basis"][1][0] != 0, axis=-1)
    np.testing.assert_array_equal(used.sum(1), 1)
