"""Rounding: how much error it adds, and what half floats make of its values."""

from dataclasses import replace

import numpy as np
import pytest
from small_btf import make_model, make_samples, write_dataset

from addon.models import fit
from addon.models.exr import load_model, save_model
from addon.models.fit import compress
from addon.models.precision import SHARE, round_model

SHAPE = (12, 14, 20, 24, 3)
RANKS = {"light": 6, "view": 4, "y": 8, "x": 8}
SETTINGS = {
    "nsvd": {"ranks": RANKS},
    "kcta": {"ranks": RANKS, "clusters": {"view": 3}, "mixtures": {"view": 2}},
}


def arrays(model):
    return [model.core, *model.bases.values()]


def squared_error(model, samples):
    return np.sum((model.decode().astype(float) - samples) ** 2)


@pytest.fixture(params=SETTINGS, scope="module")
def fitted(request, tmp_path_factory):
    """(the model before rounding, its samples, its squared error)"""
    samples = make_samples(SHAPE, noise=0.5)
    dataset = write_dataset(tmp_path_factory.mktemp("precision") / "a.nacre", SHAPE, samples)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fit, "round_model", lambda model, error: model)
        model = compress(dataset, request.param, **SETTINGS[request.param])
    return model, samples, squared_error(model, samples.astype(float))


def test_rounding_adds_its_share_of_the_error(fitted):
    model, samples, error = fitted
    added = squared_error(round_model(model, error), samples) - error
    assert 0.5 * SHARE < added / error < 2.0 * SHARE


def test_half_floats_hold_the_rounded_numbers(fitted, tmp_path):
    model, _, error = fitted
    rounded = round_model(model, error)
    for array, original in zip(arrays(rounded), arrays(model), strict=True):
        peak = np.abs(original).max()
        assert np.abs(array).max() == peak
        relative = array / peak
        same = np.abs(relative.astype(np.float16) - relative) <= np.abs(relative) * 1e-6
        assert same.mean() > 0.8
    save_model(rounded, tmp_path / "m.exr")
    for array, stored in zip(arrays(rounded), arrays(load_model(tmp_path / "m.exr")), strict=True):
        np.testing.assert_allclose(stored, array, rtol=2.0**-10.9)


def test_rounding_again_changes_next_to_nothing(fitted):
    model, _, error = fitted
    once = round_model(model, error)
    twice = round_model(once, error)
    changed = [np.mean(a != b) for a, b in zip(arrays(once), arrays(twice), strict=True)]
    assert max(changed) < 0.01


@pytest.mark.parametrize("error", [0.0, 1e-30, 1.0, 1e30])
def test_any_error_leaves_numbers(error):
    """Also of several clustered modes, whose bases have other owners than the core has."""
    model = make_model(
        clusters={"light": 2, "view": 3}, mixtures={"light": 1, "view": 2}, shared=("y", "x")
    )
    rounded = round_model(model, error)
    for array, original in zip(arrays(rounded), arrays(model), strict=True):
        assert array.dtype == np.float32
        assert np.abs(array - original).max() <= np.abs(original).max() / 16
    if error < 1e-9:
        np.testing.assert_allclose(rounded.core, model.core, rtol=1e-6)


def test_a_model_of_zeros_stays_one():
    model = make_model()
    zero = replace(
        model,
        core=np.zeros_like(model.core),
        bases={mode: np.zeros_like(basis) for mode, basis in model.bases.items()},
    )
    for array in arrays(round_model(zero, 1.0)):
        np.testing.assert_array_equal(array, 0.0)
