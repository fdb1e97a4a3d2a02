"""Scalar products in the reduced space against those of whole subtensors."""

import numpy as np
import pytest
from dense_model import dense_basis
from small_btf import make_model

from addon.models.clustered_tucker import MODES
from addon.models.subspaces import subspace_gram

SHAPE = (4, 5, 3, 4, 2)
KINDS = {
    "nsvd": {},
    "kcta": {"clusters": {"view": 3}, "mixtures": {"view": 2}, "shared": ("light",)},
    "kcta of local bases": {"clusters": {"view": 3}, "mixtures": {"view": 2}},
    "mkcta": {
        "clusters": {"light": 2, "view": 3},
        "mixtures": {"light": 2, "view": 2},
        "shared": ("y", "x"),
    },
    "mkcta of one basis a mode": {
        "clusters": {"light": 3, "view": 2},
        "mixtures": {"light": 2},
        "shared": MODES,
    },
    "every mode": {
        "clusters": {"light": 2, "view": 3, "y": 2, "x": 2},
        "mixtures": {"light": 2, "view": 2, "x": 2},
    },
}


def spans(model, mode):
    """For each cluster of a mode the rows (S, elements) that span its subtensors: the sum over the
    owners that share a row, or one row after the other for each owner."""
    axis = MODES.index(mode)
    clusters = model.clusters.get(mode, 1)
    found = [[] for _ in range(clusters)]
    for number, indices in enumerate(np.ndindex(*model.clusters.values())):
        vector = dict(zip(model.clusters, indices, strict=True))
        whole = model.core[number].astype(float)
        for n, name in enumerate(MODES):
            if name != mode:
                basis = dense_basis(model, name, vector).astype(float)
                whole = np.moveaxis(np.tensordot(basis, whole, (1, n)), 0, n)
        rows = np.moveaxis(whole, axis, 0)
        found[vector.get(mode, 0)].append(rows.reshape(len(rows), -1))
    shared = len(model.bases[mode]) == 1
    return [np.sum(rows, 0) if shared else np.concatenate(rows) for rows in found]


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
@pytest.mark.parametrize("mode", MODES)
def test_gram_is_that_of_whole_subtensors(kind, mode):
    model = make_model(SHAPE, **kind)
    rows = spans(model, mode)
    expected = np.array([[first @ second.T for second in rows] for first in rows])
    gram = subspace_gram(model, mode)
    assert gram.shape == expected.shape
    np.testing.assert_allclose(gram, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())
