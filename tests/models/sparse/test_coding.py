"""Coding a dataset: the error, qualities, resumed, within a bound of memory."""

from dataclasses import replace
from types import SimpleNamespace

import nacre_native
import numpy as np
import pytest
from small_btf import hemisphere, write_dataset
from trained import EVERY, FEW, PATCH, SHAPE, one_line, train

from addon.errors import Cancelled, NacreError
from addon.models.checkpoint import StateFile
from addon.models.sparse import coding
from addon.models.sparse.coding import code, measure
from addon.models.sparse.ensemble import choose
from addon.models.sparse.model import Codes, quality_of, room_of
from addon.models.sparse.patches import read_patches


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
    for quality in range(2, model.quality):
        texels = 8 * 12  # of whole patches
        assert model.truncated(quality).code_bytes <= 2 * quality * texels
    assert model.truncated(10**6) is model


def test_sizes_are_those_of_latent_equivalents():
    # SparseBTF(N): at most 2 N bytes a texel for values, positions and membership.
    for quality in (16, 32, 256):
        room = room_of(quality, ("Y", "U", "V"), (10, 10))
        assert 2 * quality * 100 - 3 < 3 * room + 12 <= 2 * quality * 100
        assert quality_of({"Y": room - 2, "U": 1, "V": 1}, (10, 10)) == quality


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


def test_a_quality_is_divided_as_the_dataset_needs(dataset, ensemble):
    """The division whose error is least, of all that take as much."""
    quality = 16
    model = code(dataset, ensemble, quality)
    assert model.quality == quality and model.code_bytes <= 2 * quality * 8 * 12
    room = room_of(quality, ("Y", "U", "V"), PATCH)
    assert sum(model.sparsity.values()) == room
    even = code(dataset, ensemble, dict.fromkeys("YUV", room // 3))
    assert model.fit["snr_db"] > even.fit["snr_db"]


def test_the_coefficients_of_a_quality_are_no_more_than_there_are(dataset):
    ensemble = train([dataset], sparsity={"YUV": 80})
    model = code(dataset, ensemble, 10**4)
    assert model.sparsity == {"YUV": 3 * 16 * 42}


def test_a_quality_without_room_is_refused(dataset):
    ensemble = train([dataset], patch=(1, 1), sparsity=dict.fromkeys("YUV", 3))
    with pytest.raises(NacreError) as error:
        code(dataset, ensemble, 2)
    one_line(error, "Y, U, V", "1 x 1", "quality 11")
    assert code(dataset, ensemble, 11).sparsity == dict.fromkeys("YUV", 1)
