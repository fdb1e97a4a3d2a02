"""Models of occlusion: fitted, decoded, saved and loaded, and what they are refused for."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from fibres import fibre_masks, views, write_occlusion
from small_btf import make_model, write_dataset

from addon.datasets.occlusion import is_covered, with_value
from addon.errors import NacreError
from addon.models import checkpoint
from addon.models.clustered_tucker import ClusteredTucker, modes_of
from addon.models.exr import load_model, save_model
from addon.models.fit import QUALITIES, compress, quality_settings
from addon.tables.evaluate import evaluate_occlusion
from addon.tables.tables import build_tables

VIEWS = views(around=8)
MASKS = fibre_masks(VIEWS, 48, threads=3, radius=0.07)
RANKS = {"view": 4, "y": 24, "x": 24}
CLUSTERED = {"ranks": RANKS, "clusters": {"view": 7}}
SETTINGS = {
    "nsvd": {"ranks": {**RANKS, "view": 28}},
    "cta": CLUSTERED,
    "kcta": {**CLUSTERED, "mixtures": {"view": 3}},
    "mkcta": {"ranks": RANKS, "clusters": {"view": 3, "x": 2}, "mixtures": {"view": 2, "x": 1}},
}


@pytest.fixture(scope="module")
def masks(tmp_path_factory):
    return write_occlusion(tmp_path_factory.mktemp("occlusion") / "a.nacre", MASKS, VIEWS)


@pytest.fixture(scope="module")
def distances(masks):
    return with_value(masks, "signed-distance")


@pytest.fixture(scope="module")
def fitted(distances):
    """Models of the distances by method."""
    return {method: compress(distances, method, **given) for method, given in SETTINGS.items()}


def error_texels(model):
    return np.count_nonzero(is_covered(model.decode(), model.dataset["value"]) != MASKS)


@pytest.mark.parametrize("method", SETTINGS)
def test_a_model_is_what_was_asked_for(method, fitted, distances):
    model, given = fitted[method], SETTINGS[method]
    assert (model.kind, model.modes) == ("occlusion", ("view", "y", "x"))
    assert model.shape == distances.shape
    assert model.ranks == given["ranks"]
    assert model.clusters == given.get("clusters", {})
    count = np.prod(list(model.clusters.values()), dtype=int)
    assert model.core.shape == (count, *given["ranks"].values())
    assert list(model.bases) == ["view", "y", "x"]
    owners = {"nsvd": (1, 1, 1), "cta": (1, 7, 7), "kcta": (1, 7, 7), "mkcta": (2, 1, 3)}[method]
    assert tuple(len(basis) for basis in model.bases.values()) == owners
    assert set(model.dataset) == {
        "view", "value", "patch_size", "periodic", "noise_floor_db", "source",
    }  # fmt: skip
    assert model.dataset["value"] == "signed-distance"


@pytest.mark.parametrize("method", SETTINGS)
def test_the_reported_error_is_the_decoded_one(method, fitted, distances):
    model = fitted[method]
    difference = model.decode() - distances.samples
    error = np.sum(difference**2, dtype=float) / np.sum(distances.samples**2, dtype=float)
    assert model.fit["errors"][-1] == pytest.approx(error, rel=1e-3)


@pytest.mark.parametrize("method", SETTINGS)
def test_a_block_is_a_part_of_the_whole(method, fitted):
    model = fitted[method]
    block = model.decode(view=[5, 2], y=slice(3, 17), x=slice(None, None, 3))
    expected = model.decode()[[5, 2], 3:17, ::3]
    assert block.shape == expected.shape
    np.testing.assert_allclose(block, expected, atol=1e-5)


@pytest.mark.parametrize("method", SETTINGS)
def test_a_model_comes_back(method, fitted, tmp_path):
    save_model(fitted[method], tmp_path / "m.exr")
    loaded = load_model(tmp_path / "m.exr")
    assert (loaded.kind, loaded.dataset) == ("occlusion", fitted[method].dataset)
    np.testing.assert_allclose(loaded.decode(), fitted[method].decode(), atol=5e-3)
    save_model(loaded, tmp_path / "again.exr")
    assert (tmp_path / "again.exr").read_bytes() == (tmp_path / "m.exr").read_bytes()


def test_full_ranks_give_the_masks_back(masks, distances):
    ranks = dict(zip(("view", "y", "x"), MASKS.shape, strict=True))
    for dataset in (masks, distances):
        assert error_texels(compress(dataset, "nsvd", ranks=ranks)) == 0


def test_it_is_the_fit_of_a_btf_with_one_light(distances, tmp_path):
    """Of one channel, with a global light basis, which is the one number 1 or -1."""
    samples = distances.samples[None, ..., None]
    btf = write_dataset(tmp_path / "btf.nacre", samples.shape, samples, view=VIEWS.tolist())
    ranks = {"light": 1, **RANKS}
    expected = compress(btf, "kcta", **{**SETTINGS["kcta"], "ranks": ranks})
    found = compress(distances, "kcta", **SETTINGS["kcta"])
    np.testing.assert_array_equal(found.members["view"], expected.members["view"])
    np.testing.assert_allclose(found.decode(), expected.decode()[0, ..., 0], atol=1e-3)


def test_distances_and_mixtures_leave_fewer_wrong_texels(masks, fitted):
    """The relations of K-CTA's Table I, at equal sizes."""
    binary = {method: compress(masks, method, **SETTINGS[method]) for method in ("nsvd", "kcta")}
    wrong = {method: error_texels(model) for method, model in fitted.items()}
    assert 1.5 * wrong["nsvd"] <= error_texels(binary["nsvd"])
    assert 1.5 * wrong["kcta"] <= error_texels(binary["kcta"])
    assert 1.5 * wrong["kcta"] <= wrong["cta"]


@pytest.mark.parametrize("method", ["nsvd", "kcta"])
def test_better_quality_is_better(method, distances):
    models = [
        compress(distances, method, **quality_settings(distances, method, quality))
        for quality in QUALITIES
    ]
    wrong = [error_texels(model) for model in models]
    assert wrong == sorted(wrong, reverse=True)
    assert wrong[0] > 2 * wrong[2]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"ranks": {"light": 1, **RANKS}}, ["'light'", "view, y, x"]),
        ({"ranks": {"view": 4, "y": 4}}, ["mode x", "view=..,y=..,x=.."]),
        ({"ranks": {**RANKS, "y": 49}}, ["y=49", "48 rows"]),
        ({"clusters": {"light": 2}}, ["'light'", "view, y, x"]),
        ({"global_modes": ("light",)}, ["'light'", "y or x"]),
    ],
    ids=str,
)
def test_wrong_settings_are_named_in_one_line(changes, words, distances):
    with pytest.raises(NacreError) as error:
        compress(distances, "kcta", **{**SETTINGS["kcta"], **changes})
    text = str(error.value)
    assert "\n" not in text
    for word in words:
        assert word in text


def test_a_fit_of_other_values_is_not_gone_on_with(masks, distances, tmp_path, monkeypatch):
    """A state says whether it is of masks or of distances."""
    clock = itertools.count(step=100.0)  # nothing is saved in the first second
    monkeypatch.setattr(checkpoint, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    monkeypatch.setattr(checkpoint.Checkpoint, "remove", lambda self: None)
    given = {**SETTINGS["kcta"], "state": tmp_path / "state"}
    first = compress(distances, "kcta", **given)
    again = compress(distances, "kcta", **given, resume=True)
    np.testing.assert_array_equal(again.core, first.core)
    with pytest.raises(NacreError, match="other settings"):
        compress(masks, "kcta", **given, resume=True)


def test_tables_are_those_of_the_model_at_its_views(fitted):
    model = fitted["kcta"]
    views = np.asarray(model.dataset["view"])
    seen = evaluate_occlusion(build_tables(model, 256), views)
    # A texel of the map is nearest to each view, half a degree away at most.
    assert np.abs(seen - model.decode()).mean() < 0.05 * np.abs(model.decode()).mean()


def test_modes_follow_from_the_kind():
    assert modes_of("btf") == make_model().modes == ("light", "view", "y", "x")
    assert modes_of("occlusion") == ("view", "y", "x")
    assert ClusteredTucker.__dataclass_fields__["kind"].default == "btf"
