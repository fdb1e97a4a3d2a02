"""The numpy fits that the compiled ones are measured against are themselves right."""

from itertools import combinations

import numpy as np
import pytest

from benchmarks import numpy_kcta, numpy_mkcta
from benchmarks._tensors import kmeans, split_empty, tensor_of

from ..native import reference

LIGHT, VIEW = 0, 1


@pytest.fixture
def samples():
    """(light 6, view 9, y 5, x 4, channel 2): smooth in the directions, with some noise."""
    random = np.random.default_rng(3)
    light, view = np.linspace(0, 1, 6), np.linspace(0, 1, 9)
    phase = random.uniform(0, 6, (5, 4, 2))
    angle = 7 * light[:, None, None, None, None] - 5 * view[:, None, None, None] + phase
    return (1 + np.sin(angle) + random.normal(0, 0.2, angle.shape)).astype(np.float32)


def labels_of(items, clusters):
    return np.arange(items) * clusters // items


def test_kmeans_finds_separate_groups():
    centres = np.array([[0, 0], [9, 0], [0, 9]])
    points = np.repeat(centres, 4, 0) + np.random.default_rng(0).normal(0, 0.1, (12, 2))
    labels = kmeans(points, 3)
    assert len(set(labels)) == 3 and np.array_equal(labels, np.repeat(labels[::4], 4))


def test_an_empty_cluster_takes_the_worse_half_of_the_worst():
    members = [np.array([0, 1]), np.array([], int), np.array([2, 3, 4])]
    assert list(split_empty(members, np.array([1, 1, 5, 0, 3.0]))) == [(1, 2)]
    assert [list(items) for items in members] == [[0, 1], [2], [3, 4]]


@pytest.mark.parametrize("mixtures", [1, 2, 3])
def test_kcta_is_the_dense_reference(samples, mixtures):
    ranks, labels = (5, 2, 3, 2), labels_of(9, 4)
    _, _, errors = numpy_kcta.fit(samples, ranks, 4, mixtures, 4, labels=labels)
    expected, _ = reference.kcta(samples, ranks, labels, mixtures, 4)
    shared = min(len(errors), len(expected))
    assert shared > 2
    np.testing.assert_allclose(errors[:shared], expected[:shared], rtol=1e-4)


class Dense:
    """MK-CTA in the space of the projected tensor: sums over clusters, nothing reduced."""

    def __init__(self, fit):
        self.fit = fit
        self.tensor = fit.tensor.astype(np.float64)

    def part(self, a, b):
        light, view = (self.fit.bases[n][a, b].astype(np.float64) for n in range(2))
        return np.einsum("ir,js,rsp->ijp", light, view, self.fit.core[a, b])

    def whole(self):
        return sum(self.part(a, b) for a, b in np.ndindex(self.fit.counts))

    def subspaces(self, n):
        """For each cluster of mode n the rows that span what its items may be (Eqs. 6 and 7)."""
        spans = []
        for c in range(self.fit.counts[n]):
            rows = []
            for o in range(self.fit.counts[1 - n]):
                a, b = (c, o) if n == LIGHT else (o, c)
                core = np.moveaxis(self.fit.core[a, b].astype(np.float64), n, 0)
                other = self.fit.bases[1 - n][a, b].astype(np.float64)
                expanded = np.einsum("rsp,js->rjp", core, other)
                rows.append(expanded.reshape(len(core), -1))
            spans.append(np.concatenate(rows))
        return spans

    def error_of(self, spans, items, clusters):
        """The least squares error of some items in the subspaces of these clusters, Eq. 20."""
        basis = np.concatenate([spans[c] for c in clusters]).T
        return np.sum((items.T - basis @ np.linalg.lstsq(basis, items.T, rcond=1e-4)[0]) ** 2)

    def groups(self, n):
        """The items of each group that shares its clusters, as rows."""
        items = np.moveaxis(self.tensor, n, 0).reshape(self.tensor.shape[n], -1)
        return items.reshape(-1, self.fit.tied[n], items.shape[1])


def fit_mkcta(samples, ranks, clusters, mixtures, iterations):
    labels = tuple(labels_of(samples.shape[n], clusters[n]) for n in range(2))
    return numpy_mkcta.fit(samples, ranks, clusters, mixtures, iterations, labels=labels)


@pytest.mark.parametrize("mode", [LIGHT, VIEW])
@pytest.mark.parametrize("mixtures", [1, 2])
def test_the_optimal_search_finds_the_best_of_all_sets(samples, mode, mixtures):
    fit, _, _ = fit_mkcta(samples, (2, 2, 5, 4), (3, 4), (2, 2), 1)
    dense = Dense(fit)
    spans = dense.subspaces(mode)
    sets = list(combinations(range(fit.counts[mode]), mixtures))
    lowest = sum(
        min(dense.error_of(spans, items, one) for one in sets) for items in dense.groups(mode)
    )
    fit.cluster(mode, mixtures)
    assert np.all(fit.members[mode].sum(0) == mixtures)
    assert np.sum((dense.tensor - dense.whole()) ** 2) == pytest.approx(lowest, rel=1e-4)


@pytest.mark.parametrize("mode", [LIGHT, VIEW])
def test_the_greedy_search_adds_the_cluster_that_leaves_least(samples, mode):
    fit, _, _ = fit_mkcta(samples, (1, 1, 5, 4), (4, 4), (2, 2), 1)
    dense = Dense(fit)
    spans = dense.subspaces(mode)
    left = 0.0
    for items in dense.groups(mode):
        chosen = []
        for _ in range(3):
            rest = [c for c in range(4) if c not in chosen]
            errors = [dense.error_of(spans, items, [*chosen, c]) for c in rest]
            chosen.append(rest[int(np.argmin(errors))])
        left += min(errors)
    fit.cluster(mode, 3)
    assert np.sum((dense.tensor - dense.whole()) ** 2) == pytest.approx(left, rel=1e-4)


def test_colours_of_a_light_share_their_clusters(samples):
    fit, _, _ = fit_mkcta(samples, (2, 2, 4, 3), (3, 4), (2, 2), 3)
    shared = fit.members[LIGHT].reshape(3, 6, 2)
    assert np.array_equal(shared[..., 0], shared[..., 1])
    for n in range(2):
        rows = fit.bases[n].any(-1)
        members = fit.members[n][:, None] if n == LIGHT else fit.members[n][None]
        assert not np.any(rows & ~members)


def test_a_decomposed_cluster_is_the_n_svd_of_what_the_others_leave(samples):
    fit, _, _ = fit_mkcta(samples, (2, 2, 5, 4), (2, 3), (2, 2), 2)
    for n in range(2):
        fit.cluster(n, 2)
    fit.refresh()
    for a, b in np.ndindex(fit.counts):
        before = Dense(fit)
        place = np.ix_(fit.members[LIGHT][a], fit.members[VIEW][b])
        residual = (before.tensor - before.whole() + before.part(a, b))[place]
        view = fit.bases[VIEW][a, b, fit.members[VIEW][b]].astype(np.float64)
        # One sweep of alternating least squares.
        light = leading(np.einsum("ijp,jr->irp", residual, view))
        view = leading(np.einsum("ijp,ir->jrp", residual, light))
        core = np.einsum("ijp,ir,js->rsp", residual, light, view)
        expected = np.einsum("rsp,ir,js->ijp", core, light, view)
        fit.decompose_one(a, b)
        np.testing.assert_allclose(Dense(fit).part(a, b)[place], expected, atol=2e-4)
    np.testing.assert_allclose(fit.left, dense_left(fit), atol=1e-4)


def leading(seen):
    return np.linalg.svd(seen.reshape(len(seen), -1), full_matrices=False)[0][:, :2]


def dense_left(fit):
    dense = Dense(fit)
    return dense.tensor - dense.whole()


def test_mkcta_error_is_that_of_the_decoded_samples(samples):
    fit, (y, x), errors = fit_mkcta(samples, (2, 2, 4, 3), (3, 4), (2, 2), 6)
    tensor = tensor_of(samples).astype(np.float64)
    decoded = Dense(fit).whole().reshape(*tensor.shape[:2], 4, 3)
    decoded = np.einsum("abcd,yc,xd->abyx", decoded, y, x)
    assert np.sum((tensor - decoded) ** 2) / np.sum(tensor**2) == pytest.approx(
        errors[-1], rel=1e-4
    )
    assert np.all(np.diff(errors) <= 0) and errors[-1] < 0.7 * errors[0]
    assert np.allclose(y.T @ y, np.eye(4), atol=1e-5) and np.allclose(x.T @ x, np.eye(3), atol=1e-5)


def test_whole_clusters_lose_nothing(samples):
    """Ranks of the modes themselves: every cluster is exact."""
    fit, _, errors = fit_mkcta(samples, (6, 3, 5, 4), (2, 3), (1, 1), 0)
    assert errors[0] < 1e-10 or np.isclose(errors[0], 0, atol=1e-6)
    assert fit.counts == (2, 3)


def test_clusters_that_nothing_needs_are_filled():
    """All sets explain a constant tensor alike, so the search leaves clusters empty."""
    samples = np.ones((6, 9, 5, 4, 2), np.float32)
    fit, _, _ = fit_mkcta(samples, (1, 1, 1, 1), (3, 4), (2, 2), 0)
    for n in range(2):
        fit.cluster(n, 2)
        assert np.all(fit.members[n].any(1)) and np.all(fit.members[n].sum(0) == 2)
        assert np.abs(dense_left(fit)).max() < 1e-3


def test_empty_kcta_clusters_are_filled_without_a_change():
    samples = np.ones((6, 9, 5, 4, 2), np.float32)
    fit, _, _ = numpy_kcta.fit(samples, (1, 1, 1, 1), 4, 2, 0, labels=labels_of(9, 4))
    fit.search(2)
    assert all(len(cluster.members) for cluster in fit.clusters)
    approximated = fit.mixing.reshape(9, -1) @ fit.expanded.reshape(4, -1)
    np.testing.assert_allclose(approximated, fit.flat, atol=1e-4)
