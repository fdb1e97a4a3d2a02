"""Files of ensembles and models: any quality, cut anywhere, damaged, read part-way."""

import json

import numpy as np
import pytest
from trained import EVERY, SHAPE, one_line

from addon.errors import NacreError
from addon.models.any_model import load_any
from addon.models.exr import load_model
from addon.models.sparse import files
from addon.models.sparse.coding import code
from addon.models.sparse.ensemble import largest_misfit, orthonormal
from addon.models.sparse.files import (
    load_ensemble,
    load_progressively,
    load_sparse,
    save_ensemble,
    save_sparse,
)
from addon.samples import open_samples


@pytest.fixture
def path(tmp_path, model):
    save_sparse(model, tmp_path / "m.exr")
    return tmp_path / "m.exr"


def test_an_ensemble_comes_back_orthonormal(ensemble, tmp_path):
    save_ensemble(ensemble, tmp_path / "e.exr")
    loaded = load_ensemble(tmp_path / "e.exr")
    for key, modes in ensemble.dictionaries.items():
        assert largest_misfit(loaded.dictionaries[key]) < 1e-6
        for a, b in zip(modes, loaded.dictionaries[key], strict=True):
            np.testing.assert_allclose(a, b, atol=1e-3)
    assert loaded.training == json.loads(json.dumps(ensemble.training))
    assert (loaded.patch, loaded.offset) == (ensemble.patch, ensemble.offset)
    with pytest.raises(NacreError) as error:
        load_any(tmp_path / "e.exr")
    one_line(error, "e.exr")


def test_nearly_orthonormal_matrices_become_so():
    rng = np.random.default_rng(0)
    exact = np.stack([np.linalg.qr(rng.normal(size=(30, 30)))[0] for _ in range(3)])
    halves = exact.astype(np.float16)
    assert largest_misfit([halves]) > 1e-5
    assert largest_misfit([orthonormal(halves)]) < 1e-6
    np.testing.assert_allclose(orthonormal(halves), exact, atol=1e-3)


def test_a_model_comes_back(model, path):
    loaded = load_any(path)
    assert loaded.complete and loaded.quality == model.quality
    assert loaded.sparsity == model.sparsity
    assert (loaded.dataset, loaded.fit) == (model.dataset, model.fit)
    for key, codes in model.codes.items():
        np.testing.assert_array_equal(loaded.codes[key].positions, codes.positions)
        np.testing.assert_array_equal(loaded.codes[key].members, codes.members)
    np.testing.assert_allclose(loaded.decode(), model.decode(), rtol=0.02, atol=0.02)
    assert open_samples(path).shape == SHAPE
    with pytest.raises(NacreError) as error:  # materials cannot be made of it
        load_model(path)
    one_line(error, "sparse")
    np.testing.assert_allclose(  # the ensemble inside codes other datasets
        load_ensemble(path).dictionaries["Y"][0], model.ensemble.dictionaries["Y"][0], atol=1e-3
    )


def test_a_lower_quality_is_a_prefix(model, path):
    whole = load_sparse(path)
    low = load_sparse(path, 4)
    assert low.quality == 4 and not low.complete
    np.testing.assert_array_equal(low.decode(), whole.truncated(4).decode())
    assert load_sparse(path, 5).quality == 4
    with pytest.raises(NacreError) as error:
        load_sparse(path, 0)
    one_line(error, "lowest quality")


def test_a_file_cut_anywhere_loads_to_less_or_is_refused(path, tmp_path):
    data = path.read_bytes()
    whole = load_sparse(path)
    cut = tmp_path / "cut.exr"
    seen = []
    for size in [*range(0, len(data), max(1, len(data) // 60)), len(data) - 1]:
        cut.write_bytes(data[:size])
        try:
            loaded = load_sparse(cut)
        except NacreError as error:
            assert "\n" not in str(error) and "cut.exr" in str(error)
            seen.append(0)
            continue
        assert not loaded.complete
        seen.append(loaded.quality)
        kept = whole.truncated(loaded.quality)
        for key in "YUV":
            np.testing.assert_array_equal(loaded.codes[key].values, kept.codes[key].values)
    assert seen == sorted(seen) and seen[0] == 0 and len(set(seen)) > 3


@pytest.fixture(scope="module")
def large(dataset, ensemble, tmp_path_factory):
    """A file that is more coefficients than headers."""
    path = tmp_path_factory.mktemp("large") / "m.exr"
    save_sparse(code(dataset, ensemble, EVERY), path)
    return path


def test_a_file_is_shown_while_it_is_read(large):
    whole = load_sparse(large)
    found = list(load_progressively(large))
    qualities = [one.quality for one in found]
    assert qualities == sorted(set(qualities)) and len(found) > 1
    assert found[-1].complete and not found[0].complete
    for one in found:
        np.testing.assert_array_equal(one.decode(), whole.truncated(one.quality).decode())


def test_what_is_read_of_a_cut_file_ends_with_what_is_whole(large, tmp_path):
    data = large.read_bytes()
    cut = tmp_path / "cut.exr"
    cut.write_bytes(data[: int(0.9 * len(data))])
    *_, last = load_progressively(cut)
    assert last.quality == load_sparse(cut).quality < load_sparse(large).quality
    assert not last.complete
    cut.write_bytes(data[: len(data) // 20])
    with pytest.raises(NacreError) as error:
        next(load_progressively(cut))
    one_line(error, "cut.exr")
    with pytest.raises(NacreError):
        next(load_progressively(tmp_path / "absent.exr"))


def test_a_file_is_read_no_further_than_a_quality_asks_for(large, monkeypatch):
    calls = []

    def counted(path):
        for model in load_progressively(path):
            calls.append(model.quality)
            yield model

    monkeypatch.setattr(files, "load_progressively", counted)
    file = files.OpenFile(large)
    best = load_sparse(large).quality
    low = list(file.up_to(1))
    assert [one.quality for one in low] == [1] and calls[-1] < best
    steps = list(file.up_to(best))
    assert steps[-1].quality == best == calls[-1] and len(steps) > 1
    before = list(calls)
    assert [one.quality for one in file.up_to(4)] == [4]
    assert [one.quality for one in file.up_to(best + 10)] == [best]
    assert calls == before  # read once
    assert files.promised_quality(large) == best


def test_damage_is_never_taken_for_samples(path, tmp_path):
    data = path.read_bytes()
    whole = load_sparse(path)
    rng = np.random.default_rng(1)
    for place in rng.integers(0, len(data), 40):
        broken = bytearray(data)
        broken[place] ^= 0x15
        (tmp_path / "broken.exr").write_bytes(broken)
        try:
            loaded = load_sparse(tmp_path / "broken.exr")
        except NacreError as error:
            assert "\n" not in str(error)
            continue
        kept = whole.truncated(loaded.quality)
        np.testing.assert_array_equal(loaded.decode(), kept.decode())
