"""Fits whose errors are weighed by lightness."""

import numpy as np
import pytest
from fibres import fibre_masks, views, write_occlusion
from small_btf import make_samples, write_dataset

from addon.errors import Cancelled, NacreError
from addon.models import checkpoint
from addon.models.fit import METHODS, compress
from addon.models.lightness import compress_by_lightness

SHAPE = (6, 7, 12, 10, 3)
RANKS = {"light": 6, "view": 3, "y": 6, "x": 5}
KCTA = {"ranks": RANKS, "clusters": {"view": 3}, "mixtures": {"view": 2}}
GIVEN = {
    "nsvd": {"ranks": RANKS},
    "cta": {**KCTA, "mixtures": {"view": 1}},
    "kcta": KCTA,
    "mkcta": {
        "ranks": RANKS,
        "clusters": {"light": 2, "view": 3},
        "mixtures": {"light": 2, "view": 2},
    },
}


@pytest.fixture
def glossy(tmp_path):
    """Dim colours with few highlights a hundred times as bright, which hold most of the energy."""
    rng = np.random.default_rng(7)
    samples = 0.1 * np.abs(make_samples(SHAPE))
    samples[rng.random(SHAPE[:4]) < 0.01] *= 100.0
    return write_dataset(tmp_path / "glossy.nacre", SHAPE, samples.astype(np.float32))


def lightness_error(model, samples):
    """Mean difference of CIE lightness, white where a screen is."""
    seen = (np.cbrt(np.clip(one, 0.0, 1.0)) for one in (model.decode(), samples))
    return float(np.abs(np.subtract(*seen)).mean())


@pytest.mark.parametrize("method", METHODS)
def test_what_is_seen_is_closer_than_with_equal_weights(method, glossy, tmp_path):
    equal = compress(glossy, method, **GIVEN[method])
    seen = compress_by_lightness(glossy, method, folder=tmp_path, **GIVEN[method])
    errors = [lightness_error(model, glossy.samples) for model in (seen, equal)]
    assert errors[0] < 0.7 * errors[1]
    assert seen.ranks == equal.ranks
    assert seen.clusters == equal.clusters
    assert seen.fit["snr_db"] <= equal.fit["snr_db"]


def test_values_stay_linear(glossy, tmp_path):
    model = compress_by_lightness(glossy, "kcta", folder=tmp_path, **KCTA)
    assert model.domain == "linear"
    assert model.fit["weights"] == "lightness"


def test_what_can_be_held_is_held(tmp_path):
    """Of a dataset of these ranks nothing is lost, whatever the weights."""
    basis = [np.random.default_rng(n).random((size, 2)) for n, size in enumerate(SHAPE[:4])]
    core = np.random.default_rng(9).random((2, 2, 2, 2, 3))
    samples = np.einsum("abcdk,ia,jb,mc,nd->ijmnk", core, *basis).astype(np.float32)
    dataset = write_dataset(tmp_path / "low.nacre", SHAPE, samples)
    model = compress_by_lightness(dataset, "nsvd", folder=tmp_path, ranks=RANKS)
    assert model.fit["snr_db"] > 35.0
    assert model.fit["errors"] == sorted(model.fit["errors"], reverse=True)


def test_nothing_is_left_on_disk(glossy, tmp_path):
    before = sorted(tmp_path.iterdir())
    compress_by_lightness(glossy, "kcta", folder=tmp_path, state=tmp_path / "state", **KCTA)
    assert sorted(tmp_path.iterdir()) == before
    with pytest.raises(Cancelled):
        compress_by_lightness(
            glossy, "kcta", folder=tmp_path, state=tmp_path / "state", **KCTA,
            progress=lambda fraction, message: fraction < 0.5,
        )  # fmt: skip
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("share", [0.1, 0.45, 0.8])
def test_a_fit_that_was_killed_ends_the_same(share, glossy, tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, "_LEAST", 0.0)
    monkeypatch.setattr(checkpoint, "_SHARE", 1e9)
    whole = compress_by_lightness(glossy, "kcta", folder=tmp_path, **KCTA)
    again = {"folder": tmp_path, "state": tmp_path / "state", "resume": True, **KCTA}

    class Killed(BaseException):
        pass

    def kill(fraction, message):
        if fraction > share:
            raise Killed
        return True

    with pytest.raises(Killed):
        compress_by_lightness(glossy, "kcta", **again, progress=kill)
    resumed = compress_by_lightness(glossy, "kcta", **again)
    np.testing.assert_array_equal(resumed.decode(), whole.decode())
    assert not list(tmp_path.glob("state*"))


def test_another_fit_does_not_go_on(glossy, tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, "_LEAST", 0.0)
    monkeypatch.setattr(checkpoint, "_SHARE", 1e9)
    again = {"folder": tmp_path, "state": tmp_path / "state", "resume": True}
    with pytest.raises(Cancelled):
        compress_by_lightness(
            glossy, "kcta", **again, **KCTA, progress=lambda fraction, message: fraction < 0.5
        )
    with pytest.raises(NacreError, match="other settings or samples"):
        compress_by_lightness(glossy, "kcta", **again, **KCTA, seed=1)


def test_occlusion_has_no_lightness(tmp_path):
    masks = write_occlusion(tmp_path / "masks.nacre", fibre_masks(views()))
    with pytest.raises(NacreError, match="lightness is of colours"):
        compress_by_lightness(masks, "kcta", folder=tmp_path, ranks=RANKS)


def test_a_full_disk_is_said_in_one_line(glossy, tmp_path):
    with pytest.raises(NacreError, match="cannot write to"):
        compress_by_lightness(glossy, "kcta", folder=tmp_path / "missing", **KCTA)
