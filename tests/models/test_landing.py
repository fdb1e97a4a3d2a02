"""Rounding that lands on a target, on what is read back from a saved file."""

import os

import numpy as np
import pytest
from small_btf import make_samples, write_dataset

from addon.errors import Cancelled
from addon.models.exr import load_model, save_model
from addon.models.fit import compress
from addon.models.landing import MOST, land_on_bytes, land_on_quality, quality, saved_bytes
from addon.models.precision import round_model

SHAPE = (12, 14, 20, 24, 3)
SETTINGS = {
    "nsvd": {"ranks": {"light": 8, "view": 6, "y": 8, "x": 12}},
    "kcta": {
        "ranks": {"light": 8, "view": 4, "y": 8, "x": 12},
        "clusters": {"view": 3},
        "mixtures": {"view": 2},
    },
}


def go_on(fraction, message):
    return True


@pytest.fixture(params=SETTINGS, scope="module")
def fitted(request, tmp_path_factory):
    """(model, its squared error, its SNR, the dataset)"""
    samples = make_samples(SHAPE, noise=0.3)
    dataset = write_dataset(tmp_path_factory.mktemp("landing") / "a.nacre", SHAPE, samples)
    model = compress(dataset, request.param, **SETTINGS[request.param])
    energy = np.sum(np.square(samples, dtype=float))
    return model, model.fit["errors"][-1] * energy, model.fit["snr_db"], dataset


def snr_db(model, dataset):
    difference = model.decode().astype(float) - dataset.samples
    return 10.0 * np.log10(np.sum(dataset.samples.astype(float) ** 2) / np.sum(difference**2))


@pytest.mark.parametrize("below", [0.05, 0.2, 0.6, 1.0])
def test_it_lands_on_a_quality(below, fitted, tmp_path):
    model, error, fit_db, dataset = fitted
    landed, reached = land_on_quality(
        model, error, fit_db, fit_db - below, dataset, tmp_path, go_on
    )
    assert fit_db - below <= reached <= fit_db - below + 0.03
    assert os.listdir(tmp_path) == []
    assert saved_bytes(landed, tmp_path) < saved_bytes(model, tmp_path)
    save_model(landed, tmp_path / "m.exr")
    assert snr_db(load_model(tmp_path / "m.exr"), dataset) == pytest.approx(reached, abs=1e-4)


def test_a_fit_that_is_not_good_enough_does_not_land(fitted, tmp_path):
    model, error, fit_db, dataset = fitted
    assert land_on_quality(model, error, fit_db, fit_db + 0.1, dataset, tmp_path, go_on) is None


def test_a_fit_that_is_far_too_good_is_not_spoilt(fitted, tmp_path):
    model, error, fit_db, dataset = fitted
    _, reached = land_on_quality(model, error, fit_db, 1.0, dataset, tmp_path, go_on)
    assert reached > fit_db - 10.0 * np.log10(1.0 + 1.2 * MOST)


@pytest.mark.parametrize("share", [0.001, 0.01, 0.1])
def test_it_lands_on_a_size(share, fitted, tmp_path):
    model, error, _, dataset = fitted
    limit = saved_bytes(round_model(model, error, share), tmp_path) + 20
    landed, reached = land_on_bytes(model, error, limit, dataset, tmp_path, go_on)
    assert 0.98 * limit <= saved_bytes(landed, tmp_path) <= limit
    assert reached == pytest.approx(snr_db(landed, dataset), abs=1e-3)
    assert os.listdir(tmp_path) == []


def test_a_size_that_no_rounding_reaches(fitted, tmp_path):
    model, error, _, dataset = fitted
    half = saved_bytes(model, tmp_path) // 2
    assert land_on_bytes(model, error, half, dataset, tmp_path, go_on) is None


def test_no_error_has_no_decibels(fitted, tmp_path):
    *_, dataset = fitted
    shape = (3, 3, 4, 4, 3)
    black = write_dataset(tmp_path / "black.nacre", shape, np.zeros(shape, np.float32))
    model = compress(black, "nsvd", ranks={"light": 1, "view": 1, "y": 1, "x": 1})
    assert quality(model, black, tmp_path, go_on) == 120.0


def test_a_no_stops_and_leaves_nothing(fitted, tmp_path):
    model, error, fit_db, dataset = fitted
    for land in (
        lambda: land_on_quality(
            model, error, fit_db, fit_db - 0.2, dataset, tmp_path, lambda *_: False
        ),
        lambda: land_on_bytes(model, error, 10**6, dataset, tmp_path, lambda *_: False),
    ):
        with pytest.raises(Cancelled):
            land()
        assert os.listdir(tmp_path) == []
