"""What every model must be, and whether two are the same."""

import numpy as np

from . import reference


def assert_same(first, second):
    """The same bits."""
    np.testing.assert_array_equal(first["core"], second["core"])
    assert first["errors"] == second["errors"]
    assert first["squared_norm"] == second["squared_norm"]
    assert first["members"].keys() == second["members"].keys()
    for mode, members in first["members"].items():
        np.testing.assert_array_equal(members, second["members"][mode])
    for a, b in zip(first["basis"], second["basis"], strict=True):
        np.testing.assert_array_equal(a, b)


def check_shapes(model, samples, ranks, clusters, mixtures, global_modes):
    """Cores and bases as documented: K R values a row, owners, members of each item ascending."""
    light, view, y, x, channel = samples.shape
    count = int(np.prod([*clusters.values()]))
    assert model["core"].shape == (count, *ranks) and model["core"].dtype == np.float32
    for mode, (basis, rows) in enumerate(
        zip(model["basis"], (light * channel, view, y, x), strict=True)
    ):
        owners = 1 if mode in global_modes else count // clusters.get(mode, 1)
        assert basis.shape == (owners, rows, mixtures.get(mode, 1), ranks[mode])
        assert basis.dtype == np.float32 and np.all(np.isfinite(basis))
    assert [*model["members"]] == sorted(clusters)
    for mode, members in model["members"].items():
        items = light if mode == 0 else samples.shape[mode]
        assert members.shape == (items, mixtures.get(mode, 1)) and members.dtype == np.uint32
        assert np.all(np.diff(members.astype(int), axis=1) > 0)
        assert set(members.ravel()) == set(range(clusters[mode]))  # none is empty


def check_bases(model, clusters):
    """min(R, members) orthonormal columns, and the rest zero, in every basis of every cluster."""
    vectors = np.ndindex(*(clusters[mode] for mode in sorted(clusters)))
    for vector, bases in zip(vectors, reference.cluster_bases(model, clusters), strict=True):
        at = dict(zip(sorted(clusters), vector, strict=True))
        for mode, u in enumerate(bases):
            rank = u.shape[1]
            gram = u.T @ u
            columns = round(np.trace(gram))
            expected = np.diag((np.arange(rank) < columns).astype(float))
            np.testing.assert_allclose(gram, expected, atol=1e-5)
            if mode not in clusters:
                assert columns == rank
                continue
            members = model["members"][mode]
            rows = np.any(members == at[mode], axis=1).sum() * (len(u) // len(members))
            # A fit that ends before it has mixtures fills its rows up with zeros.
            filled = np.any(u != 0, axis=1).sum()
            assert min(rank, filled) <= columns <= min(rank, rows)
            if filled == rows:
                assert columns == min(rank, rows)


def check_errors(model, samples, clusters):
    """Never rising, and the last one is that of the reconstruction."""
    errors = np.array(model["errors"])
    assert np.all(np.diff(errors) <= 0) and model["iterations"] == len(errors) - 1
    energy = np.sum(np.square(samples, dtype=float))
    np.testing.assert_allclose(model["squared_norm"], energy, rtol=1e-5)
    left = reference.tensor_of(samples) - reference.reconstruct(model, clusters)
    found = np.sum(left**2) / energy if energy > 0 else 0
    np.testing.assert_allclose(errors[-1], found, rtol=1e-3, atol=1e-6)
