"""Models of log luminance with chroma decode to linear values."""

from dataclasses import replace

import numpy as np
import pytest
from measured import WOOL, compressed, measured
from small_btf import make_model, make_samples, write_dataset

from addon.datasets.bonn.colour_models import ColourModel
from addon.datasets.dataset import open_dataset
from addon.errors import Cancelled, NacreError
from addon.models.domain import OFFSET, to_linear, to_log
from addon.models.exr import load_model, save_model
from addon.models.fit import compress
from addon.models.snr import measure_snr

SHAPE = (6, 7, 8, 10, 3)
WHOLE = {"light": 18, "view": 7, "y": 8, "x": 10}
FEW = {"light": 5, "view": 3, "y": 4, "x": 5}
METHODS = {
    "nsvd": {"method": "nsvd", "ranks": FEW},
    "kcta": {
        "method": "kcta",
        "ranks": FEW,
        "clusters": {"view": 3},
        "mixtures": {"view": 2},
    },
    "mkcta": {
        "method": "mkcta",
        "ranks": FEW,
        "clusters": {"light": 2, "view": 3},
        "mixtures": {"light": 2, "view": 2},
    },
}
EACH = pytest.mark.parametrize("settings", METHODS.values(), ids=METHODS)


def colours():
    rng = np.random.default_rng(0)
    return (10.0 ** rng.uniform(-4, 2, (500, 1)) * rng.random((500, 3))).astype(np.float32)


def snr(a, b):
    return 10.0 * np.log10(np.sum(np.square(a, dtype=float)) / np.sum((a.astype(float) - b) ** 2))


def test_there_and_back():
    rgb = colours()
    values = to_log(rgb)
    assert values.dtype == to_linear(values).dtype == np.float32
    np.testing.assert_allclose(to_linear(values), rgb, rtol=1e-4, atol=1e-6)


def test_white_and_black():
    np.testing.assert_allclose(to_log(np.ones(3)), [np.log(1.01), 0.0, 0.0], atol=1e-5)
    np.testing.assert_allclose(to_log(np.zeros(3)), [np.log(0.01), 0.0, 0.0], atol=1e-5)
    np.testing.assert_allclose(to_linear(to_log(np.zeros((4, 3)))), 0.0, atol=1e-8)


def test_it_is_colour_model_11_of_measured_files_with_another_offset():
    rgb = colours() + 0.1
    luminance = rgb @ np.array([0.299, 0.587, 0.114])
    log, u, v = np.moveaxis(to_log(rgb), -1, 0)
    planes = [np.log(np.exp(log) - OFFSET + 1e-5)]
    planes += [chroma * (luminance + OFFSET) / (luminance + 1e-5) for chroma in (u, v)]
    model = ColourModel(11, np.zeros(3), np.eye(3))
    decoded = model.decode(np.stack(planes).astype(np.float32))
    # The files' matrix has five digits.
    assert (np.abs(np.moveaxis(decoded, 0, -1) - rgb) < 1e-4 * rgb.max(1, keepdims=True)).all()


def test_a_model_of_logarithms_decodes_to_their_exponentials():
    model = make_model((3, 4, 5, 6, 3))
    expected = to_linear(0.01 * model.decode())
    model = replace(model, core=0.01 * model.core, fit={**model.fit, "domain": "log"})
    assert model.domain == "log"
    np.testing.assert_allclose(model.decode(), expected, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(
        model.decode(light=[2], y=slice(1, 3)), expected[[2], :, 1:3], rtol=1e-4, atol=1e-5
    )


def test_whole_ranks_lose_nothing(tmp_path):
    samples = make_samples(SHAPE)
    dataset = write_dataset(tmp_path / "d.nacre", SHAPE, samples)
    model = compress(dataset, "nsvd", ranks=WHOLE, domain="log")
    np.testing.assert_allclose(model.decode(), samples, rtol=5e-3, atol=1e-3)


@EACH
def test_the_snr_is_that_of_linear_values(settings, tmp_path):
    dataset = write_dataset(tmp_path / "d.nacre", SHAPE, make_samples(SHAPE) ** 2)
    settings = {**settings}
    method = settings.pop("method")
    model = compress(dataset, method, **settings, domain="log")
    assert model.fit["domain"] == model.domain == "log"
    assert model.fit["snr_db"] == pytest.approx(snr(dataset.samples, model.decode()), abs=1e-3)
    in_domain = snr(to_log(dataset.samples), to_log(model.decode()))
    assert -10.0 * np.log10(model.fit["errors"][-1]) == pytest.approx(in_domain, abs=0.1)
    save_model(model, tmp_path / "m.exr")
    loaded = load_model(tmp_path / "m.exr")
    assert loaded.domain == "log"
    np.testing.assert_allclose(loaded.decode(), model.decode(), rtol=0.01, atol=2e-3)
    assert compress(dataset, method, **settings).domain == "linear"


def test_the_error_is_measured_in_blocks(tmp_path, monkeypatch):
    dataset = write_dataset(tmp_path / "d.nacre", SHAPE)
    model = compress(dataset, "nsvd", ranks=FEW)
    assert measure_snr(dataset, model) == pytest.approx(model.fit["snr_db"], abs=1e-3)
    monkeypatch.setattr("addon.models.snr._BLOCK", 1)
    seen = []
    found = measure_snr(dataset, model, lambda *now: seen.append(now[0]) or True)
    assert found == pytest.approx(model.fit["snr_db"], abs=1e-3)
    assert seen == [light / 6 for light in range(6)]
    with pytest.raises(Cancelled):
        measure_snr(dataset, model, lambda *_: False)


@pytest.mark.parametrize(
    ("domain", "channels", "words"),
    [("lab", 3, ["'lab'", "linear, log"]), ("log", 2, ["R, G, B"]), ("log", 1, ["R, G, B"])],
)
def test_what_cannot_be_fitted_is_refused(domain, channels, words, tmp_path):
    dataset = write_dataset(tmp_path / "d.nacre", (*SHAPE[:4], channels))
    with pytest.raises(NacreError) as error:
        compress(dataset, "nsvd", ranks={**FEW, "light": 3}, domain=domain)
    assert "\n" not in str(error.value)
    for word in words:
        assert word in str(error.value)


def test_on_real_data_it_is_nearer_to_what_the_eye_sees(tmp_path_factory):
    """Lightness of the same ranks' models against the samples'."""
    dataset = open_dataset(measured(WOOL, tmp_path_factory))
    linear = load_model(compressed(WOOL, "nsvd", tmp_path_factory))
    log = compress(dataset, "nsvd", ranks=linear.ranks, domain="log")
    some = slice(None, None, 5)
    wanted = lightness(dataset.samples[some, some].astype(np.float32))
    errors = [
        np.sqrt(np.mean((lightness(model.decode(some, some)) - wanted) ** 2))
        for model in (linear, log)
    ]
    assert errors[1] < 0.92 * errors[0]
    assert log.fit["snr_db"] < linear.fit["snr_db"]


def lightness(values):
    """CIE L* of linear colours."""
    luminance = np.maximum(values @ np.array([0.2126, 0.7152, 0.0722], np.float32), 0.0)
    return np.where(luminance > 0.008856, 116.0 * np.cbrt(luminance) - 16.0, 903.3 * luminance)
