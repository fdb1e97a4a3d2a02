"""Training an ensemble: resumed, in subspaces, sampled; and what is refused."""

from itertools import pairwise

import nacre_native
import numpy as np
import pytest
from small_btf import write_dataset
from trained import FEW, PATCH, one_line, train

from addon.errors import Cancelled, NacreError
from addon.models.sparse import training
from addon.models.sparse.coding import code
from addon.models.sparse.ensemble import largest_misfit
from addon.models.sparse.files import (
    load_sparse,
    save_sparse,
)
from addon.models.sparse.patches import channels_of, overlapping, read_patches
from addon.models.sparse.transform import normalisation


def test_training_is_resumed_to_the_same_bits(dataset, ensemble, tmp_path):
    calls = []

    def interrupt(fraction, message):
        calls.append(message)
        return not (message.endswith("sweep 3") and fraction > 0.5)  # within U

    state = tmp_path / "state"
    with pytest.raises(Cancelled):
        train([dataset], state=state, folder=tmp_path, progress=interrupt)
    assert {p.name for p in state.iterdir()} == {"Y.npz", "U.npz"}
    assert [p.name for p in tmp_path.iterdir()] == ["state"]  # no patches are left
    resumed = train([dataset], state=state, resume=True)
    for key, modes in ensemble.dictionaries.items():
        for a, b in zip(modes, resumed.dictionaries[key], strict=True):
            np.testing.assert_array_equal(a, b)
    assert resumed.training["objective"] == ensemble.training["objective"]
    assert not state.exists()


def test_training_in_subspaces_gives_whole_dictionaries(dataset):
    """What is coded with them is what training says, or better: atoms beyond may be chosen, too."""
    trained = train([dataset], subspace=4)
    for key, modes in trained.dictionaries.items():
        assert [own.shape for own in modes] == [(2, size, size) for size in trained.shape(key)]
        assert largest_misfit(modes) < 1e-5
        errors = trained.training["objective"][key]
        assert all(b <= a for a, b in pairwise(errors))
        normalised = normalisation(dataset, trained.offset)
        origins = overlapping(dataset, PATCH)
        patches = np.concatenate(
            [part for _, part in read_patches(dataset, normalised, PATCH, origins)]
        )
        values = channels_of(patches, key)
        found = nacre_native.code_patches(values, modes, FEW[key])
        share = found["errors"].sum() / np.square(values, dtype=np.float64).sum()
        assert share <= errors[-1] + 2e-3
        assert share > 0.5 * errors[-1]


def test_a_state_of_another_training_is_refused(dataset, tmp_path):
    state = tmp_path / "state"
    with pytest.raises(Cancelled):
        train([dataset], state=state, progress=lambda f, m: not m.endswith("sweep 2"))
    with pytest.raises(NacreError) as error:
        train([dataset], state=state, resume=True, seed=5)
    one_line(error, "other settings")
    (state / "Y.npz").write_bytes(b"PK")
    with pytest.raises(NacreError) as error:
        train([dataset], state=state, resume=True)
    one_line(error, "damaged")


def test_many_patches_are_sampled(dataset, monkeypatch):
    monkeypatch.setattr(training, "_ALL", 7)
    assert train([dataset, dataset]).training["patches"] == 7
    monkeypatch.setattr(training, "_ALL", 2)
    assert train([dataset, dataset]).training["patches"] == 4  # a tenth of 40


@pytest.mark.parametrize("key", ["YUV", "Y"])
def test_wrong_trainings_are_refused(dataset, tmp_path, key):
    with pytest.raises(NacreError) as error:
        train([dataset], patch=(9, 4))
    one_line(error, "9", "a.nacre")
    with pytest.raises(NacreError) as error:
        train([dataset], sparsity={key: 10**5})
    one_line(error, f"{key}=100000")
    with pytest.raises(NacreError) as error:
        train([dataset], offset=1e30)
    one_line(error, "offset 1e+30")
    with pytest.raises(NacreError) as error:
        train([dataset], dictionaries=1000)
    one_line(error, "dictionaries")
    other = write_dataset(tmp_path / "b.nacre", (6, 8, 8, 10, 3))
    with pytest.raises(NacreError) as error:
        train([dataset, other])
    one_line(error, "b.nacre", "7 views", "8")


def test_colour_may_be_a_fifth_mode(dataset, tmp_path):
    ensemble = train([dataset], sparsity={"YUV": 80})
    assert [m.shape for m in ensemble.dictionaries["YUV"]] == [
        (2, 4, 4),
        (2, 4, 4),
        (2, 6, 6),
        (2, 7, 7),
        (2, 3, 3),
    ]
    model = code(dataset, ensemble, {"YUV": 80})
    save_sparse(model, tmp_path / "m.exr")
    loaded = load_sparse(tmp_path / "m.exr")
    np.testing.assert_allclose(loaded.decode(), model.decode(), atol=0.02)
    texel = loaded.texel(2, 3, 4, 5)
    np.testing.assert_allclose(texel, loaded.decode()[2, 3, 4, 5], rtol=1e-3, atol=1e-5)
    every = code(dataset, ensemble, {"YUV": 16 * 42 * 3})
    assert every.fit["snr_db"] > 35
