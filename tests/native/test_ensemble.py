"""Training and coding with orthonormal dictionaries, against plain numpy."""

import numpy as np
import pytest

nacre_native = pytest.importorskip("nacre_native")

SHAPE = (3, 4, 6, 5)
SPARSITY = 6
EXACT = 1e-5


def orthonormal(rng, size):
    return np.linalg.qr(rng.normal(size=(size, size)))[0]


def project(patch, matrices):
    """Eq. 3, for any number of modes."""
    for mode, matrix in enumerate(matrices):
        patch = np.moveaxis(np.tensordot(matrix, patch, (0, mode)), 0, mode)
    return patch


def make_patches(shape=SHAPE, count=40, dictionaries=3, seed=2):
    """Patches of few coefficients in the dictionaries in turn, and these, (K, I, I) a mode."""
    rng = np.random.default_rng(seed)
    planted = [np.stack([orthonormal(rng, m) for _ in range(dictionaries)]) for m in shape]
    patches = []
    for i in range(count):
        sparse = np.zeros(shape)
        sparse.flat[rng.choice(sparse.size, SPARSITY, False)] = rng.uniform(1, 2, SPARSITY)
        patches.append(project(sparse, [m[i % dictionaries].T for m in planted]))
    return np.array(patches, np.float32), planted


def objective(patches, dictionaries, sparsity):
    """Eq. 2a over the squared norm, with the best coefficients and members."""
    left = 0.0
    for patch in patches.astype(float):
        found = [project(patch, [m[k] for m in dictionaries]) for k in range(len(dictionaries[0]))]
        left += min(np.sort(np.square(s), axis=None)[:-sparsity].sum() for s in found)
    return left / np.square(patches, dtype=float).sum()


@pytest.fixture(scope="module")
def planted():
    return make_patches()


def train(patches, **changes):
    settings = {"dictionaries": 3, "sparsity": SPARSITY, "sweeps": 10, "tolerance": 0.0}
    return nacre_native.fit_ensemble(patches, **(settings | changes))


@pytest.mark.parametrize("shape", [SHAPE, (6, 7, 5), (2, 2, 5, 6, 3), (30,)])
def test_the_objective_falls_for_any_number_of_modes(shape):
    patches, _ = make_patches(shape)
    found = train(patches)
    errors = found["errors"]
    assert len(errors) == found["sweeps"] + 1
    assert all(b <= a + EXACT for a, b in zip(errors[:-1], errors[1:], strict=True))
    assert errors[-1] < 0.8 * errors[0]
    assert errors[-1] == pytest.approx(
        objective(patches, found["dictionaries"], SPARSITY), abs=1e-5
    )
    assert max(found["orthonormality"]) < 1e-6


def test_planted_dictionaries_are_nearly_found(planted):
    patches, _ = planted
    assert train(patches, sweeps=60)["errors"][-1] < 0.1


@pytest.mark.parametrize("reassign", [1, 3])
def test_resumed_and_threaded_trainings_have_the_same_bits(planted, reassign):
    patches, _ = planted
    states = []
    whole = train(patches, reassign=reassign, checkpoint=states.append)
    for other in (
        train(patches, reassign=reassign, threads=1),
        train(patches, reassign=reassign, start=states[4]),
    ):
        assert other["errors"] == whole["errors"]
        np.testing.assert_array_equal(other["members"], whole["members"])
        for a, b in zip(other["dictionaries"], whole["dictionaries"], strict=True):
            np.testing.assert_array_equal(a, b)


def test_a_mapped_file_of_halves_is_trained_as_its_values(planted, tmp_path):
    patches = planted[0].astype(np.float16)
    np.save(tmp_path / "p.npy", patches)
    mapped = train(np.load(tmp_path / "p.npy", mmap_mode="r"))
    assert mapped["errors"] == train(patches.astype(np.float32))["errors"]


def test_codes_are_the_largest_coefficients(planted):
    patches, dictionaries = planted
    found = nacre_native.code_patches(patches, dictionaries, 4)
    for i, patch in enumerate(patches):
        expected = project(patch.astype(float), [m[found["members"][i]] for m in dictionaries])
        order = np.argsort(-np.abs(expected), axis=None, kind="stable")[:4]
        np.testing.assert_allclose(found["values"][i], expected.flat[order], atol=1e-5)
        assert set(found["positions"][i]) == set(order)
        left = np.square(expected).sum() - np.square(found["values"][i], dtype=float).sum()
        assert found["errors"][i] == pytest.approx(left, abs=1e-4)
    total = np.square(patches, dtype=float).sum()
    assert found["errors"].sum() / total == pytest.approx(
        objective(patches, dictionaries, 4), abs=1e-5
    )


def test_the_sparsest_dictionary_is_chosen(planted):
    patches, dictionaries = planted
    found = nacre_native.code_patches(patches, dictionaries, 100, error=1e-8)
    np.testing.assert_array_equal(found["members"], np.arange(len(patches)) % 3)
    assert found["counts"].max() <= SPARSITY
    unused = np.arange(100) >= found["counts"][:, None]
    assert (found["values"][unused] == 0).all()


def test_progress_can_stop(planted):
    with pytest.raises(nacre_native.Cancelled):
        train(planted[0], progress=lambda fraction, message: fraction < 0.3)
    fractions = []
    train(planted[0], progress=lambda fraction, message: fractions.append(fraction))
    assert fractions == sorted(fractions) and fractions[-1] == 1.0


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"dictionaries": 0}, "dictionaries"),
        ({"dictionaries": 41}, "dictionaries"),
        ({"sparsity": 0}, "sparsity"),
        ({"sparsity": 10**6}, "sparsity"),
        ({"sweeps": -1}, "sweeps"),
        ({"reassign": 0}, "reassign"),
        ({"tolerance": -1.0}, "tolerance"),
        ({"start": {}}, "start"),
    ],
)
def test_wrong_arguments_are_named(planted, changes, word):
    with pytest.raises(ValueError, match=word) as error:
        train(planted[0], **changes)
    assert "\n" not in str(error.value)


def test_wrong_patches_and_dictionaries_are_named(planted):
    patches, dictionaries = planted
    broken = patches.copy()
    broken[3, 0, 0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="patch 3"):
        train(broken)
    for wrong in (patches.astype(np.float64), patches[:, ::2], patches[:, 0, 0, 0, 0]):
        with pytest.raises(ValueError, match="patches"):
            train(wrong)
    for wrong in (
        dictionaries[:3],
        [m[:, :2] for m in dictionaries],
        [2 * m for m in dictionaries],
    ):
        with pytest.raises(ValueError, match="dictionaries"):
            nacre_native.code_patches(patches, wrong, 3)
