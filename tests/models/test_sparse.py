"""SparseBTF: training, coding, decoding, files of any quality, other directions."""

import json
import os
import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import nacre_native
import numpy as np
import pytest
from small_btf import hemisphere, write_dataset

from addon.errors import Cancelled, NacreError
from addon.models.any_model import load_any
from addon.models.checkpoint import StateFile
from addon.models.exr import load_model
from addon.models.sparse import authors, coding, files, training
from addon.models.sparse.coding import code, measure
from addon.models.sparse.ensemble import choose, largest_misfit, orthonormal
from addon.models.sparse.files import (
    load_ensemble,
    load_progressively,
    load_sparse,
    save_ensemble,
    save_sparse,
)
from addon.models.sparse.interpolation import at_directions, images_at_directions, weights
from addon.models.sparse.model import Codes, quality_of, sparsity_of
from addon.models.sparse.patches import channels_of, overlapping, read_patches, tiling
from addon.models.sparse.transform import Normalisation, normalisation
from addon.samples import open_samples

SHAPE = (6, 7, 8, 10, 3)  # patches of 4 x 4 reach over the edge along x
PATCH = (4, 4)
EVERY = {key: 16 * 42 for key in "YUV"}
FEW = {"Y": 60, "U": 12, "V": 12}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return write_dataset(tmp_path_factory.mktemp("sparse") / "a.nacre", SHAPE)


def train(datasets, **changes):
    settings = {"patch": PATCH, "dictionaries": 2, "sweeps": 4, "sparsity": FEW}
    return training.train(datasets, **(settings | changes))


@pytest.fixture(scope="module")
def ensemble(dataset):
    return train([dataset])


@pytest.fixture(scope="module")
def model(dataset, ensemble):
    return code(dataset, ensemble, FEW)


@pytest.fixture
def path(tmp_path, model):
    save_sparse(model, tmp_path / "m.exr")
    return tmp_path / "m.exr"


def one_line(error, *words):
    text = str(error.value)
    assert "\n" not in text
    for word in words:
        assert word in text


def test_patches_are_the_normalised_samples(dataset):
    normalised = normalisation(dataset, 0.01)
    origins = tiling(8, 10, PATCH)
    assert origins[:4] == [(0, 0), (0, 4), (0, 8), (4, 0)]
    found = np.concatenate([p for _, p in read_patches(dataset, normalised, PATCH, origins)])
    assert found.shape == (6, 4, 4, 6, 7, 3)
    whole = np.moveaxis(normalised.code(dataset.samples), (0, 1), (2, 3))
    np.testing.assert_array_equal(found[1], whole[0:4, 4:8])
    # A periodic dataset goes on at the other side, another one repeats its last texel.
    np.testing.assert_array_equal(found[5], whole[4:8][:, [8, 9, 0, 1]])
    still = replace(dataset, periodic=False)
    edge = np.concatenate([p for _, p in read_patches(still, normalised, PATCH, origins)])
    np.testing.assert_array_equal(edge[5], whole[4:8][:, [8, 9, 9, 9]])
    assert (6, 8) in overlapping(dataset, PATCH) and (6, 8) not in overlapping(still, PATCH)


@pytest.mark.parametrize("by_deviation", [False, True])
@pytest.mark.parametrize("offset", [1e-5, 0.01, 8.0])
def test_images_are_normalised_and_come_back(dataset, offset, by_deviation):
    normalised = normalisation(dataset, offset, by_deviation)
    values = normalised.code(dataset.samples)
    if by_deviation:
        np.testing.assert_allclose(values.mean((2, 3, 4)), 0.0, atol=1e-4)
        np.testing.assert_allclose(values.std((2, 3, 4)), 1.0, atol=1e-3)
    else:
        np.testing.assert_allclose(values.mean((2, 3)), 0.0, atol=1e-4)
        assert (normalised.deviation == 1.0).all()
    back = normalised.decode(values, np.arange(6), np.arange(7))
    np.testing.assert_allclose(back, dataset.samples, rtol=1e-3, atol=1e-4)


def test_all_coefficients_are_the_samples(dataset, ensemble):
    model = code(dataset, ensemble, EVERY)
    assert model.fit["snr_db"] > 35  # values are of one byte


def test_rounded_values_are_of_one_byte():
    values = np.random.default_rng(0).standard_normal((50, 40)).astype(np.float32) ** 3
    values[40:, ::2] = 0
    positions = np.indices(values.shape, np.uint32)[0]
    codes = Codes(positions, values, np.zeros(40, np.uint32))
    rounded = codes.rounded()
    assert len(np.unique(rounded.values)) <= 255
    found = np.zeros_like(values)
    np.put_along_axis(found, rounded.positions, rounded.values, 0)
    np.testing.assert_array_equal(np.sign(found), np.sign(values))
    large = np.abs(values) > np.abs(values).max() / 2**12
    np.testing.assert_allclose(found[large], values[large], rtol=0.036)
    assert (np.diff(np.abs(rounded.values), axis=0) <= 0).all()
    nothing = replace(codes, values=0 * values)
    assert not nothing.rounded().values.any()


def test_error_falls_with_every_quality(dataset, model):
    errors = [measure(dataset, model.truncated(q))["mse"] for q in (2, 4, 8, model.quality)]
    assert errors == sorted(errors, reverse=True) and errors[-1] < 0.5 * errors[0]
    assert model.truncated(4).code_bytes <= 2 * 4 * 8 * 12  # texels of whole patches
    assert model.truncated(10**6) is model


def test_a_block_and_a_texel_are_parts_of_the_whole(model):
    whole = model.decode()
    assert whole.shape == SHAPE
    block = model.decode(light=slice(1, 5, 2), view=[6, 0], y=slice(3, 7), x=slice(2, None))
    np.testing.assert_allclose(block, whole[1:5:2][:, [6, 0], 3:7, 2:], rtol=1e-4, atol=1e-5)
    for light, view, y, x in [(0, 0, 0, 0), (5, 6, 7, 9), (2, 3, 4, 5)]:
        texel = model.texel(light, view, y, x)
        np.testing.assert_allclose(texel, whole[light, view, y, x], rtol=1e-3, atol=1e-5)


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


def test_sizes_are_those_of_latent_equivalents():
    # SparseBTF(N): at most 2 N bytes a texel for values, positions and membership.
    for quality in (16, 32, 256):
        counts = sparsity_of(quality, ("Y", "U", "V"), (10, 10))
        assert 4 * sum(counts.values()) + 12 <= 2 * quality * 100
        assert quality_of(counts, (10, 10)) == quality


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


class Killed(Exception):
    """Stands for the end of the process."""


def kill_while_coding(dataset, ensemble, state, monkeypatch, after=3):
    """Leave what a process that was killed leaves, each patch being saved."""
    monkeypatch.setattr(coding, "BLOCK", 1)
    monkeypatch.setattr(StateFile, "due", True)

    def kill(fraction, message):
        if message == "Coding patches" and fraction >= 0.8 * after / 6:
            raise Killed
        return True

    with pytest.raises(Killed):
        code(dataset, ensemble, FEW, state=state, progress=kill)


def test_coding_is_resumed_to_the_same_codes(dataset, ensemble, model, tmp_path, monkeypatch):
    state = tmp_path / ".m.exr.fit"
    kill_while_coding(dataset, ensemble, state, monkeypatch)
    assert [p.name for p in tmp_path.iterdir()] == [state.name]
    seen = []

    def coded(patches, *rest, **settings):
        seen.append(len(patches))
        return nacre_native.code_patches(patches, *rest, **settings)

    native = SimpleNamespace(code_patches=coded, Cancelled=nacre_native.Cancelled)
    monkeypatch.setattr(coding, "nacre_native", native)
    monkeypatch.setattr(coding, "normalisation", None)  # kept, too
    resumed = code(dataset, ensemble, FEW, state=state, resume=True)
    assert sum(seen) == 3 * 3  # of six patches in three channels
    for key, codes in model.codes.items():
        for name in ("positions", "values", "members"):
            np.testing.assert_array_equal(getattr(resumed.codes[key], name), getattr(codes, name))
    np.testing.assert_array_equal(resumed.decode(), model.decode())
    assert not list(tmp_path.iterdir())


def test_a_state_of_other_codes_is_refused(dataset, ensemble, tmp_path, monkeypatch):
    state = tmp_path / "state"
    kill_while_coding(dataset, ensemble, state, monkeypatch)
    other = train([dataset], seed=3)
    for settings in ((ensemble, FEW | {"Y": 61}), (other, FEW)):
        with pytest.raises(NacreError) as error:
            code(dataset, *settings, state=state, resume=True)
        one_line(error, "other settings")
    state.write_bytes(b"PK")
    with pytest.raises(NacreError) as error:
        code(dataset, ensemble, FEW, state=state, resume=True)
    one_line(error, "damaged")
    assert code(dataset, ensemble, FEW, state=state).fit["snr_db"] > 0  # begins again
    assert not state.exists()


def test_cancelled_coding_leaves_nothing(dataset, ensemble, tmp_path, monkeypatch):
    monkeypatch.setattr(coding, "BLOCK", 1)
    monkeypatch.setattr(StateFile, "due", True)
    for message in ("Reading samples", "Coding patches"):
        with pytest.raises(Cancelled):
            code(
                dataset,
                ensemble,
                FEW,
                state=tmp_path / "state",
                progress=lambda f, m, stop=message: m != stop or f < 0.4,
            )
        assert not list(tmp_path.iterdir())


def test_a_memory_bound_changes_nothing_but_the_block(dataset, ensemble, model, monkeypatch):
    blocks = []

    def read(*given):
        blocks.append(given[-1])
        return read_patches(*given)

    monkeypatch.setattr(coding, "read_patches", read)
    for memory in (1, 130_000_000, 2_000_000_000):
        found = code(dataset, ensemble, FEW, memory=memory)
        np.testing.assert_array_equal(found.codes["Y"].values, model.codes["Y"].values)
    assert blocks[0] < 1 < blocks[1] < blocks[2]


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


def test_an_ensemble_that_does_not_fit_is_refused(dataset, ensemble, tmp_path):
    more = write_dataset(tmp_path / "more.nacre", (6, 8, 8, 10, 3))
    turned = write_dataset(tmp_path / "turned.nacre", SHAPE, view=hemisphere(7)[::-1].tolist())
    for other, word in ((more, "7 views"), (turned, "degrees")):
        with pytest.raises(NacreError) as error:
            code(other, ensemble, FEW)
        one_line(error, word)
    other = train([more])
    assert choose({"a": ensemble, "b": other}, more) is other
    with pytest.raises(NacreError) as error:
        choose({"a": ensemble, "b": other}, turned)
    one_line(error, "turned.nacre", "a: ", "b: ")
    grey = write_dataset(tmp_path / "grey.nacre", (*SHAPE[:4], 1))
    with pytest.raises(NacreError) as error:
        code(grey, ensemble, FEW)
    one_line(error, "R, G, B")


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


def _plain(lights, views):
    """No means, and nothing to multiply with."""
    mean = np.zeros((lights, views, 3), np.float32)
    return Normalisation(mean, np.ones((lights, views), np.float32), 1.0)


@pytest.mark.parametrize("kernel", ["linear", "gaussian"])
def test_mixing_coefficients_is_mixing_images(model, kernel):
    """Eq. 6, against the four and more reconstructions that it saves."""
    lights, views = hemisphere(9)[[2, 5]], hemisphere(11)[[3, 4, 8]]
    mixed = at_directions(model, lights, views, kernel)
    # Normalised logarithms of the measured directions, and these mixed.
    plain = replace(model, normalised=_plain(6, 7))
    logarithms = plain.logarithms()
    by_light = weights(model.ensemble.light, lights, kernel)
    by_view = weights(model.ensemble.view, views, kernel)
    expected = np.einsum("al,bv,lvyxc->abyxc", by_light, by_view, logarithms)
    mixed_plain = replace(mixed, normalised=_plain(2, 3))
    np.testing.assert_allclose(mixed_plain.logarithms(), expected, atol=1e-4)
    assert mixed.shape == (2, 3, 8, 10, 3)
    np.testing.assert_allclose(
        mixed.texel(1, 2, 3, 4), mixed.decode()[1, 2, 3, 4], rtol=1e-3, atol=1e-5
    )


@pytest.mark.parametrize("kernel", ["linear", "gaussian"])
def test_images_are_mixed_of_decoded_neighbours(model, kernel):
    lights, views = hemisphere(9)[[2, 5]], hemisphere(11)[[3, 4, 8]]
    mixed = images_at_directions(model, lights, views, kernel)
    expected = np.einsum(
        "al,bv,lvyxc->abyxc",
        weights(model.ensemble.light, lights, kernel),
        weights(model.ensemble.view, views, kernel),
        model.decode(),
    )
    np.testing.assert_allclose(mixed.decode(), expected, rtol=1e-3, atol=1e-5)
    block = mixed.decode(light=[1], view=slice(1, 3), y=slice(3, 7), x=[9, 0])
    np.testing.assert_allclose(block, expected[[1], 1:3, 3:7][..., [9, 0], :], rtol=1e-3, atol=1e-5)
    # At measured directions both are what was measured.
    own = images_at_directions(model, model.ensemble.light, model.ensemble.view)
    np.testing.assert_allclose(own.decode(), model.decode(), rtol=1e-4, atol=1e-6)
    # Coefficients are mixed in logarithms, which is another thing between them.
    of_coefficients = at_directions(model, lights, views, kernel).decode()
    assert 0 < np.abs(of_coefficients - expected).mean() < 0.3 * expected.mean()


def test_weights_are_of_neighbours():
    measured = hemisphere(40)
    rng = np.random.default_rng(0)
    wanted = rng.normal(size=(60, 3))
    wanted[:, 2] = np.abs(wanted[:, 2]) + 0.3
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    for kernel in ("linear", "gaussian"):
        found = weights(measured, wanted, kernel)
        np.testing.assert_allclose(found.sum(1), 1.0, atol=1e-5)
        assert (found >= 0).all()
        # The nearest direction has the largest share, or nearly so.
        angles = np.degrees(np.arccos(np.clip(measured @ wanted.T, -1, 1))).T
        assert (angles[found > 0] < 60).all()
    linear = weights(measured, wanted, "linear")
    assert ((linear > 0).sum(1) <= 3).all()
    np.testing.assert_array_equal(weights(measured, measured, "linear"), np.eye(40))
    inside = wanted[:, 2] > 0.5
    mixed = linear[inside] @ measured
    mixed /= np.linalg.norm(mixed, axis=1, keepdims=True)
    assert np.degrees(np.arccos(np.sum(mixed * wanted[inside], 1).min())) < 3
    with pytest.raises(NacreError):
        weights(measured, measured, "cubic")


def test_nearly_orthonormal_matrices_become_so():
    rng = np.random.default_rng(0)
    exact = np.stack([np.linalg.qr(rng.normal(size=(30, 30)))[0] for _ in range(3)])
    halves = exact.astype(np.float16)
    assert largest_misfit([halves]) > 1e-5
    assert largest_misfit([orthonormal(halves)]) < 1e-6
    np.testing.assert_allclose(orthonormal(halves), exact, atol=1e-3)


# The authors' files ------------------------------------------------------------------------------

SHARED = Path(os.environ.get("NACRE_SHARED_DATA", "/nowhere")) / "sparsebtf"
published = pytest.mark.skipif(not SHARED.is_dir(), reason="the authors' files are not here")


@published
def test_the_published_ensembles_load():
    from addon.datasets.direction_sets import direction_set

    ensemble = load_ensemble(SHARED)
    assert ensemble.patch == (10, 10) and list(ensemble.dictionaries) == ["Y", "U", "V"]
    for modes in ensemble.dictionaries.values():
        assert [m.shape for m in modes] == [(8, n, n) for n in (10, 10, 151, 151)]
        assert largest_misfit(modes) < 1e-6
    np.testing.assert_allclose(ensemble.light, direction_set("ubo151"), atol=1e-3)


@published
@pytest.mark.parametrize("channel", ["U", "V"])
def test_published_codes_give_plausible_pictures(channel):
    folder = SHARED / "coefficients"
    ensemble = load_ensemble(SHARED)
    positions, values, members = authors.load_authors_codes(
        folder / f"Coeffs_BTF_carpet07_1e-05_{channel}.bin"
    )
    assert positions.shape == values.shape == (1600, 64)
    picture = np.empty((400, 400))
    light, view = 40, 0
    for patch in range(1600):
        y, x, lights, views = np.unravel_index(positions[patch], (10, 10, 151, 151))
        u = [matrices[members[patch]] for matrices in ensemble.dictionaries[channel]]
        weighed = values[patch] * u[2][light, lights] * u[3][view, views]
        block = np.einsum("c,yc,xc->yx", weighed, u[0][:, y], u[1][:, x])
        row, column = divmod(patch, 40)
        picture[10 * row : 10 * row + 10, 10 * column : 10 * column + 10] = block
    normalised = authors.load_authors_normalisation(folder / "carpet07_mean_std.bin")
    chroma = picture * normalised.deviation[light, view] + normalised.mean[light, view, 1]
    assert np.isfinite(chroma).all()
    assert np.abs(chroma).max() < 3  # of log RGB: a carpet has little colour
    # 64 coefficients for all lights and views leave seams, but fewer than patches turned over.
    blocks = picture.reshape(40, 10, 40, 10)
    turned = blocks[:, ::-1].reshape(400, 400), blocks[..., ::-1].reshape(400, 400)
    for axis, other in enumerate(turned):
        assert seams(picture, axis) < 0.8 * seams(other, axis)


def seams(picture, axis):
    """How large the steps between patches are."""
    steps = np.abs(np.diff(picture, axis=axis))
    return np.take(steps, np.arange(9, 399, 10), axis).mean()


@published
def test_damaged_published_files_are_refused(tmp_path):
    for name in ("bonn_angles.bin", "dictionaries"):
        copy = shutil.copytree if (SHARED / name).is_dir() else shutil.copyfile
        copy(SHARED / name, tmp_path / name)
    target = tmp_path / "dictionaries" / "DictEnsOrth4DU.bin"
    target.chmod(0o644)
    target.parent.chmod(0o755)
    whole = target.read_bytes()
    for content, word in ((whole[:-2], "expected"), (bytes(len(whole)), "orthonormal")):
        target.write_bytes(content)
        with pytest.raises(NacreError) as error:
            load_ensemble(tmp_path)
        one_line(error, "DictEnsOrth4DU.bin", word)
    target.unlink()
    with pytest.raises(NacreError) as error:
        load_ensemble(tmp_path)
    one_line(error, "cannot be read")
    codes = tmp_path / "c.bin"
    codes.write_bytes((SHARED / "coefficients/Coeffs_BTF_carpet07_1e-05_U.bin").read_bytes()[:-6])
    with pytest.raises(NacreError) as error:
        authors.load_authors_codes(codes)
    one_line(error, "c.bin")
