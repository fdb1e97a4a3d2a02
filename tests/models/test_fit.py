"""Fitting through `compress`: what it promises of a model, and what it says of wrong settings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_btf import make_samples, write_dataset

from addon.datasets.dataset import open_dataset
from addon.errors import Cancelled, NacreError
from addon.models.fit import METHODS, QUALITIES, compress, quality_settings

SHAPE = (6, 7, 8, 10, 3)
RANKS = {"light": 5, "view": 3, "y": 4, "x": 5}
NSVD = {"ranks": RANKS}
CTA = {"ranks": RANKS, "clusters": {"view": 2}, "mixtures": {"view": 1}}
KCTA = {"ranks": RANKS, "clusters": {"view": 3}, "mixtures": {"view": 2}}
MKCTA = {
    "ranks": RANKS,
    "clusters": {"light": 2, "view": 3},
    "mixtures": {"light": 2, "view": 2},
}
EACH = pytest.mark.parametrize(
    ("method", "given"),
    [("nsvd", NSVD), ("cta", CTA), ("kcta", KCTA), ("mkcta", MKCTA)],
    ids=METHODS,
)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return write_dataset(tmp_path_factory.mktemp("fit") / "small.nacre", SHAPE)


def relative_error(model, samples):
    return np.sum((model.decode() - samples) ** 2, dtype=float) / np.sum(samples**2, dtype=float)


@EACH
def test_a_model_is_what_was_asked_for(method, given, dataset):
    model = compress(dataset, method, **given)
    assert model.shape == SHAPE
    assert model.ranks == RANKS
    assert model.clusters == given.get("clusters", {})
    assert model.mixtures == given.get("mixtures", {})
    owners = {mode: len(basis) for mode, basis in model.bases.items()}
    lights, views = (model.clusters.get(mode, 1) for mode in ("light", "view"))
    local = 1 if method == "mkcta" else views  # its y and x are global
    assert owners == {"light": views if lights > 1 else 1, "view": lights, "y": local, "x": local}
    assert model.dataset["light"] == dataset.light.tolist()
    assert model.dataset["view"] == dataset.view.tolist()
    assert model.dataset["patch_size"] == [0.02, 0.01]
    assert model.dataset["source"] == dataset.source


@EACH
def test_the_reported_error_is_the_decoded_one(method, given, dataset):
    model = compress(dataset, method, **given)
    error = relative_error(model, dataset.samples)
    assert model.fit["errors"][-1] == pytest.approx(error, rel=1e-3)
    assert model.fit["snr_db"] == pytest.approx(-10 * np.log10(error), abs=0.01)
    assert model.fit["errors"] == sorted(model.fit["errors"], reverse=True)
    assert model.fit["method"] == method


def test_full_ranks_leave_next_to_nothing(dataset):
    ranks = {"light": 18, "view": 7, "y": 8, "x": 10}
    assert relative_error(compress(dataset, "nsvd", ranks=ranks), dataset.samples) < 1e-7


def test_more_mixtures_are_better(dataset):
    errors = [
        relative_error(
            compress(dataset, "kcta", **{**KCTA, "mixtures": {"view": k}}), dataset.samples
        )
        for k in (1, 2, 3)
    ]
    assert errors[0] > errors[1] > errors[2]


@EACH
def test_the_result_does_not_depend_on_threads(method, given, dataset):
    one, two = (compress(dataset, method, **given, seed=3, threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.core, two.core)
    for mode in one.bases:
        np.testing.assert_array_equal(one.bases[mode], two.bases[mode])
    for mode in one.members:
        np.testing.assert_array_equal(one.members[mode], two.members[mode])
    assert one.fit["errors"] == two.fit["errors"]


def test_the_seed_chooses_the_first_clusters(tmp_path):
    shape = (4, 40, 4, 4, 3)
    dataset = write_dataset(tmp_path / "many.nacre", shape)
    given = {"ranks": {"light": 3, "view": 1, "y": 2, "x": 2}, "clusters": {"view": 8}}
    members = {
        seed: compress(dataset, "cta", **given, seed=seed).members["view"].tobytes()
        for seed in (1, 2, 3, 1)
    }
    assert members[1] == compress(dataset, "cta", **given, seed=1).members["view"].tobytes()
    assert len(set(members.values())) > 1


def test_modes_are_global_or_of_each_cluster(dataset):
    model = compress(dataset, "kcta", **KCTA, global_modes=())
    assert [len(model.bases[mode]) for mode in ("light", "view", "y", "x")] == [3, 1, 3, 3]
    assert relative_error(model, dataset.samples) == pytest.approx(
        model.fit["errors"][-1], rel=1e-3
    )
    model = compress(dataset, "kcta", **KCTA, global_modes=("light", "y", "x"))
    assert [len(model.bases[mode]) for mode in ("light", "view", "y", "x")] == [1, 1, 1, 1]
    assert relative_error(model, dataset.samples) == pytest.approx(
        model.fit["errors"][-1], rel=1e-3
    )


@pytest.mark.parametrize("mode", ["light", "y", "x"])
def test_any_mode_may_be_clustered(mode, dataset):
    given = {"ranks": {**RANKS, mode: 2}, "clusters": {mode: 3}, "mixtures": {mode: 2}}
    model = compress(dataset, "kcta", **given)
    assert set(model.clusters) == {mode}
    error = relative_error(model, dataset.samples)
    assert error == pytest.approx(model.fit["errors"][-1], rel=1e-3)


@pytest.mark.parametrize("method", ["nsvd", "kcta", "mkcta"])
def test_a_killed_fit_resumes_to_the_same_result(method, dataset, tmp_path, monkeypatch):
    given = {"nsvd": NSVD, "kcta": KCTA, "mkcta": MKCTA}[method]
    whole = compress(dataset, method, **given)
    state = tmp_path / ".model.exr.fit"
    monkeypatch.setattr("addon.models.checkpoint._LEAST", 0.0)
    saves = []

    def interrupt(fraction, message):
        if state.exists():
            saves.append(message)
        if len(saves) == 3:  # as a kill would: nothing is tidied up
            raise KeyboardInterrupt
        return True

    monkeypatch.setattr("addon.models.checkpoint._SHARE", 1e9)
    with pytest.raises(KeyboardInterrupt):
        compress(dataset, method, **given, state=state, progress=interrupt)
    assert state.exists()
    resumed = compress(dataset, method, **given, state=state, resume=True)
    assert not state.exists()
    assert resumed.fit["errors"] == whole.fit["errors"]
    np.testing.assert_array_equal(resumed.core, whole.core)
    for mode, basis in whole.bases.items():
        np.testing.assert_array_equal(resumed.bases[mode], basis)


def test_a_state_of_other_settings_is_refused(dataset, tmp_path, monkeypatch):
    state = tmp_path / ".model.exr.fit"
    monkeypatch.setattr("addon.models.checkpoint._LEAST", 0.0)

    def interrupt(fraction, message):
        if state.exists():
            raise KeyboardInterrupt
        return True

    with pytest.raises(KeyboardInterrupt):
        compress(dataset, "kcta", **KCTA, state=state, progress=interrupt)
    with pytest.raises(NacreError, match="other settings"):
        compress(dataset, "kcta", **{**KCTA, "seed": 5}, state=state, resume=True)
    state.write_bytes(state.read_bytes()[:200])
    with pytest.raises(NacreError, match="damaged"):
        compress(dataset, "kcta", **KCTA, state=state, resume=True)
    compress(dataset, "kcta", **KCTA, state=state)  # from the beginning
    assert list(tmp_path.iterdir()) == []


def test_cancel_leaves_no_state(dataset, tmp_path, monkeypatch):
    monkeypatch.setattr("addon.models.checkpoint._LEAST", 0.0)
    state = tmp_path / ".model.exr.fit"
    seen = []

    def cancel(fraction, message):
        seen.append(state.exists())
        return not state.exists()

    with pytest.raises(Cancelled):
        compress(dataset, "kcta", **KCTA, state=state, progress=cancel)
    assert any(seen) and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("method", ["nsvd", "kcta", "mkcta"])
def test_a_memory_bound_does_not_change_the_result(method, dataset, tmp_path):
    given = {"nsvd": NSVD, "kcta": KCTA, "mkcta": MKCTA}[method]
    free = compress(dataset, method, **given)
    bound = compress(dataset, method, **given, memory=1, state=tmp_path / "state")
    np.testing.assert_array_equal(bound.core, free.core)
    assert list(tmp_path.iterdir()) == []


def test_coarse_to_fine_starts_closer(tmp_path):
    dataset = write_dataset(tmp_path / "fine.nacre", (4, 12, 24, 20, 3))
    given = {"ranks": {"light": 5, "view": 2, "y": 6, "x": 6}, "clusters": {"view": 3}}
    plain = compress(dataset, "kcta", **given)
    coarse = compress(dataset, "kcta", **given, coarse=2)
    assert coarse.fit["errors"][-1] < plain.fit["errors"][0]
    assert relative_error(coarse, dataset.samples) == pytest.approx(
        coarse.fit["errors"][-1], rel=1e-3
    )
    assert coarse.ranks == plain.ranks and coarse.shape == plain.shape


def test_half_floats_are_read_where_they_lie(tmp_path):
    samples = make_samples(SHAPE).astype(np.float16)
    half = write_dataset(tmp_path / "half.nacre", SHAPE, samples, np.float16)
    single = write_dataset(tmp_path / "single.nacre", SHAPE, samples.astype(np.float32))
    a, b = (compress(dataset, "kcta", **KCTA) for dataset in (half, single))
    np.testing.assert_array_equal(a.core, b.core)


def test_progress_rises_to_1_and_a_no_stops(dataset):
    seen = []
    compress(dataset, "kcta", **KCTA, progress=lambda *now: seen.append(now) or True)
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)
    assert fractions[0] >= 0.0
    assert fractions[-1] == 1.0
    assert all(message for _, message in seen)
    with pytest.raises(Cancelled):
        compress(dataset, "kcta", **KCTA, progress=lambda *_: False)


def test_what_progress_raises_comes_out(dataset):
    def interrupt(fraction, message):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compress(dataset, "kcta", **KCTA, progress=interrupt)


@pytest.mark.parametrize(
    ("method", "changes", "words"),
    [
        ("svd", {}, ["'svd'", "nsvd, cta, kcta, mkcta"]),
        ("nsvd", {"ranks": {**RANKS, "light": 19}}, ["light=19", "18 rows"]),
        ("nsvd", {"ranks": {**RANKS, "view": 8}}, ["view=8", "7 rows"]),
        ("nsvd", {"ranks": {**RANKS, "y": 0}}, ["y=0", "1 or more"]),
        ("nsvd", {"ranks": {"light": 5, "view": 3, "y": 4}}, ["no rank", "x"]),
        ("nsvd", {"ranks": {**RANKS, "z": 4}}, ["'z'", "light, view, y, x"]),
        ("nsvd", {"clusters": {"view": 2}}, ["nsvd has no clusters"]),
        ("nsvd", {"mixtures": {"view": 2}}, ["nsvd has no clusters"]),
        ("kcta", {"clusters": {}, "mixtures": {}}, ["--clusters view=C"]),
        ("mkcta", {"clusters": {}, "mixtures": {}}, ["--clusters light=C,view=C"]),
        ("mkcta", {"global_modes": ("light",)}, ["'light'", "y or x"]),
        ("kcta", {"search": "best"}, ["'best'", "auto, kcta, greedy, optimal"]),
        ("kcta", {"clusters": {"view": 2, "light": 2}}, ["--clusters view=C"]),
        ("kcta", {"clusters": {"view": 8}}, ["view=8", "the 7 of"]),
        ("kcta", {"clusters": {"view": 0}, "mixtures": {}}, ["view=0", "1 or more"]),
        ("kcta", {"clusters": {"view": 2}, "mixtures": {"view": 3}}, ["view=3", "view=2"]),
        ("kcta", {"mixtures": {"light": 1}}, ["light", "only clustered modes"]),
        ("cta", {"clusters": {"view": 3}, "mixtures": {"view": 2}}, ["cta", "not 2"]),
        ("kcta", {"global_modes": ("view",)}, ["'view'", "light or y or x"]),
        ("kcta", {"global_modes": ("u",)}, ["'u'", "light or y or x"]),
        ("kcta", {"threads": -1}, ["threads"]),
    ],
    ids=str,
)
def test_wrong_settings_are_named_in_one_line(method, changes, words, dataset):
    usual = {"nsvd": NSVD, "mkcta": MKCTA}.get(method, KCTA)
    with pytest.raises(NacreError) as error:
        compress(dataset, method, **{**usual, **changes})
    text = str(error.value)
    assert "\n" not in text
    for word in words:
        assert word in text


def test_a_sample_that_is_no_number_is_named(tmp_path):
    write_dataset(tmp_path / "nan.nacre", SHAPE)
    samples = np.load(tmp_path / "nan.nacre" / "samples.npy", mmap_mode="r+")
    samples[1, 2, 3, 4, 0] = np.nan
    with pytest.raises(NacreError, match="nan.nacre.*finite"):
        compress(open_dataset(tmp_path / "nan.nacre"), "nsvd", **NSVD)


def test_a_black_dataset_gives_a_black_model(tmp_path):
    dataset = write_dataset(tmp_path / "black.nacre", SHAPE, np.zeros(SHAPE, np.float32))
    for method, asked in (("nsvd", NSVD), ("kcta", KCTA), ("mkcta", MKCTA)):
        np.testing.assert_array_equal(compress(dataset, method, **asked).decode(), 0.0)


def test_better_quality_is_better_and_larger(tmp_path):
    shape = (8, 14, 24, 24, 3)
    dataset = write_dataset(tmp_path / "a.nacre", shape)
    for method in METHODS:
        models = [
            compress(dataset, method, **quality_settings(dataset, method, quality))
            for quality in QUALITIES
        ]
        errors = [relative_error(model, dataset.samples) for model in models]
        sizes = [model.core.size for model in models]
        assert errors == sorted(errors, reverse=True)
        assert sizes == sorted(sizes)
        assert len(set(sizes)) == 3


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.tuples(*[st.sampled_from([1, 2, 3, 5, 9])] * 4, st.sampled_from([1, 3])),
    st.sampled_from(METHODS),
    st.sampled_from(QUALITIES),
)
def test_a_quality_fits_any_dataset(tmp_path_factory, shape, method, quality):
    dataset = write_dataset(tmp_path_factory.mktemp("any") / "a.nacre", shape)
    given = quality_settings(dataset, method, quality)
    model = compress(dataset, method, **given)
    assert model.ranks == given["ranks"]
    assert model.shape == shape
    error = relative_error(model, dataset.samples)
    assert error == pytest.approx(model.fit["errors"][-1], rel=1e-2, abs=1e-6)
