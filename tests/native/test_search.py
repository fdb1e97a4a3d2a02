"""core_gram and search_clusters: the clustering stage of a finished model, and of other rows."""

from itertools import combinations

import nacre_native
import numpy as np
import pytest

from . import reference

SEARCHES = ("kcta", "greedy", "optimal")


@pytest.fixture(scope="module")
def reduced():
    """Random clusters in a space of 40 dimensions: rows (500, 40), wholes (6, 2, 40)."""
    rng = np.random.default_rng(9)
    return rng.normal(size=(500, 40)), rng.normal(size=(6, 2, 40))


def products(rows, wholes):
    return np.einsum("nd,crd->ncr", rows, wholes), np.einsum("jrd,csd->jcrs", wholes, wholes)


def explained(rows, wholes, members, coefficients):
    sums = np.einsum("nkr,nkrd->nd", coefficients, wholes[members])
    return np.sum(rows**2, 1) - np.sum((rows - sums) ** 2, 1)


def test_gram_of_a_model(samples, fit):
    model = fit()
    gram = nacre_native.core_gram(model["core"], model["basis"])
    basis = [b.astype(np.float64) for b in model["basis"]]
    wholes = []
    for c, core in enumerate(model["core"].astype(np.float64)):
        bases = [b[c if len(b) > 1 else 0, :, 0] for b in basis]
        bases[1] = None
        wholes.append(reference.unfold(reference.expand(core, bases), 1))
    expected = np.einsum("jrd,csd->jcrs", wholes, wholes)
    np.testing.assert_allclose(gram, expected, atol=1e-5 * np.abs(expected).max())

    # Projecting the tensor again finds coefficients that are at least as good.
    a = reference.unfold(reference.tensor_of(samples), 1)
    members, coefficients = nacre_native.search_clusters(
        np.einsum("nd,crd->ncr", a, wholes), gram, 2, candidates=model["members"][1][:, None]
    )
    left = a - np.einsum("nkr,nkrd->nd", coefficients, np.array(wholes)[members])
    assert np.sum(left**2) / np.sum(a**2) <= model["errors"][-1] * (1 + 1e-3)


@pytest.mark.parametrize("search", SEARCHES)
@pytest.mark.parametrize("mixtures", [1, 2, 3, 6])
def test_coefficients_are_least_squares(reduced, mixtures, search):
    rows, wholes = reduced
    members, coefficients = nacre_native.search_clusters(
        *products(rows, wholes), mixtures, search=search
    )
    assert members.shape == (500, mixtures) and coefficients.shape == (500, mixtures, 2)
    for row, chosen, found in zip(rows, members, coefficients, strict=True):
        stacked = wholes[chosen].reshape(-1, 40)
        expected = np.linalg.lstsq(stacked.T, row, rcond=None)[0]
        np.testing.assert_allclose(found.ravel(), expected, atol=1e-8)


def test_first_cluster_is_the_best_one(reduced):
    rows, wholes = reduced
    members, coefficients = nacre_native.search_clusters(*products(rows, wholes), 1)
    found = explained(rows, wholes, members, coefficients)
    for c in range(6):
        energy = np.sum((rows @ np.linalg.pinv(wholes[c]) @ wholes[c]) ** 2, 1)
        assert np.all(found >= energy - 1e-9)


def test_the_optimal_search_is(reduced):
    """Algorithm 2 of MK-CTA against every set; Algorithm 3 and K-CTA's search come near it."""
    rows, wholes = reduced
    inputs = products(rows, wholes)
    found = {
        search: explained(rows, wholes, *nacre_native.search_clusters(*inputs, 3, search=search))
        for search in SEARCHES
    }
    best = np.zeros(len(rows))
    for chosen in combinations(range(6), 3):
        stacked = wholes[list(chosen)].reshape(-1, 40)
        best = np.maximum(best, np.sum((rows @ np.linalg.pinv(stacked) @ stacked) ** 2, 1))
    np.testing.assert_allclose(found["optimal"], best, atol=1e-9)
    for search in ("kcta", "greedy"):
        assert np.all(found[search] <= best + 1e-9)
        assert 0.3 < np.mean(found[search] > best - 1e-9) < 1
    assert np.mean(found["greedy"]) > np.mean(found["kcta"])


@pytest.mark.parametrize("search", SEARCHES)
def test_tied_rows_share_clusters(reduced, search):
    rows, wholes = reduced
    members, coefficients = nacre_native.search_clusters(
        *products(rows, wholes), 2, search=search, tied=5
    )
    assert members.shape == (100, 2) and coefficients.shape == (500, 2, 2)
    for row, chosen, found in zip(rows, np.repeat(members, 5, 0), coefficients, strict=True):
        expected = np.linalg.lstsq(wholes[chosen].reshape(-1, 40).T, row, rcond=None)[0]
        np.testing.assert_allclose(found.ravel(), expected, atol=1e-8)
    # Five equal rows want what one of them wants.
    equal = np.repeat(rows[:100], 5, axis=0)
    one = nacre_native.search_clusters(*products(rows[:100], wholes), 2, search=search)[0]
    five = nacre_native.search_clusters(*products(equal, wholes), 2, search=search, tied=5)[0]
    np.testing.assert_array_equal(one, five)


def test_candidates_never_lose(reduced):
    rows, wholes = reduced
    inputs = products(rows, wholes)
    rng = np.random.default_rng(2)
    sets = np.stack([[rng.permutation(6)[:2] for _ in range(5)] for _ in rows])
    greedy = explained(rows, wholes, *nacre_native.search_clusters(*inputs, 2))
    helped = explained(rows, wholes, *nacre_native.search_clusters(*inputs, 2, candidates=sets))
    assert np.all(helped >= greedy - 1e-9) and np.any(helped > greedy + 1e-6)


@pytest.mark.parametrize("search", SEARCHES)
def test_dependent_clusters(reduced, search):
    rows, wholes = reduced
    wholes = np.concatenate([wholes[:2], wholes[:1], np.zeros((1, 2, 40))])  # a twin, and nothing
    inputs = products(rows, wholes)
    members, coefficients = nacre_native.search_clusters(*inputs, 4, search=search)
    both = explained(rows, wholes, *nacre_native.search_clusters(*inputs, 2))
    assert np.all(np.isfinite(coefficients)) and np.abs(coefficients).max() < 10
    np.testing.assert_allclose(explained(rows, wholes, members, coefficients), both, atol=1e-8)


@pytest.mark.parametrize("search", SEARCHES)
def test_same_bits_for_any_threads(reduced, search):
    first, second = (
        nacre_native.search_clusters(*products(*reduced), 3, search=search, threads=n)
        for n in (1, 2)
    )
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])
