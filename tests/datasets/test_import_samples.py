"""The readers against an independent one, on whole measured files (see the fixture's `how`)."""

import functools
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from addon.datasets.importing import import_dataset

FIXTURES = Path(__file__).resolve().parents[1] / "fixtures" / "datasets"
INDEPENDENT = json.loads((FIXTURES / "independent_values.json").read_text())["files"]
# Half floats hold 11 bits; the independent reader of colour model 11 is 3e-5 off itself.
HALF = 2.0**-11


@pytest.fixture(scope="module")
def imported(tmp_path_factory, measured_file):
    """A function that imports a measured file once for all tests here."""
    folder = tmp_path_factory.mktemp("measured")

    @functools.cache
    def load(name):
        return import_dataset(measured_file(name), folder / f"{name}.nacre")

    yield load
    shutil.rmtree(folder)


@pytest.mark.parametrize("name", list(INDEPENDENT))
def test_an_independent_reader_agrees(imported, name):
    dataset = imported(name)
    assert dataset.shape == (81, 81, 64, 64, 3)
    assert dataset.samples.dtype == np.float16
    rows = np.array(INDEPENDENT[name]["samples"])
    expected = rows[:, 4:]
    light, view, y, x = rows[:, :4].astype(int).T
    ours = dataset.samples[light, view, y, x].astype(np.float64)
    means = np.stack([means_of(part, name) for part in dataset.samples]).mean(axis=0)
    if name.endswith(".zip"):
        np.testing.assert_array_equal(to_8_bit(ours), expected)
    elif name.startswith("weave"):
        np.testing.assert_allclose(ours.clip(0, 1), expected, rtol=HALF, atol=4e-5)
    else:
        np.testing.assert_allclose(ours, expected, rtol=HALF, atol=2e-6)
    np.testing.assert_allclose(means, INDEPENDENT[name]["mean"], rtol=1e-5, atol=3e-5)


def to_8_bit(linear):
    return np.rint(linear ** (1 / 2.2) * 255)


def means_of(samples, name):
    """Means of each channel over (view, y, x, channel), in the independent reader's terms."""
    values = samples.astype(np.float32)
    if name.endswith(".zip"):
        values = to_8_bit(values)
    elif name.startswith("weave"):
        values = values.clip(0, 1)
    return values.mean(axis=(0, 1, 2), dtype=np.float64)


def test_the_zip_and_the_btf_of_the_weave_show_the_same_cloth(imported):
    """Also a check of the orientation: flipped, the two would not correlate."""
    btf, images = imported("weave_W64xH64_L81xV81.btf"), imported("WEAVE64.zip")
    np.testing.assert_allclose(btf.light, images.light, atol=1e-6)
    np.testing.assert_allclose(btf.view, images.view, atol=1e-6)
    for light, view in ((3, 5), (40, 17), (0, 80)):
        a = btf.samples[light, view].astype(np.float64).clip(0, 1)
        b = images.samples[light, view].astype(np.float64)
        assert np.corrcoef(a.ravel(), b.ravel())[0, 1] > 0.85
        assert np.corrcoef(a.ravel(), b[::-1].ravel())[0, 1] < 0.6


def test_the_zip_and_the_btf_of_the_weave_differ_by_their_coding(imported):
    """The .btf has 48 components of log luminance. Once the zip's images are reduced to the same,
    what is left is the JPEG's clipping and coding."""
    btf, images = (
        log_luminance(imported(name)) for name in ("weave_W64xH64_L81xV81.btf", "WEAVE64.zip")
    )
    components = np.linalg.svd(btf, full_matrices=False)[2][:48]
    reduced = images @ components.T @ components
    flipped = images.reshape(-1, 64, 64)[:, ::-1].reshape(images.shape)
    assert snr_after_gamma(images, btf) < 16
    assert snr_after_gamma(reduced, btf) > 21
    assert snr_after_gamma(flipped @ components.T @ components, btf) < 10


def log_luminance(dataset):
    """log(Y + 1e-5) (pair, texel) float32 of every sixteenth light, all views."""
    linear = np.asarray(dataset.samples[::16], np.float32) @ np.float32([0.299, 0.587, 0.114])
    return np.log(np.maximum(linear, 0) + np.float32(1e-5)).reshape(-1, 64 * 64)


def snr_after_gamma(logarithms, reference):
    """dB, of values clipped to [0, 1] as a JPEG clips them."""
    a, b = (np.exp(v.astype(np.float64)).clip(0, 1) ** (1 / 2.2) for v in (logarithms, reference))
    return 10 * np.log10((b**2).sum() / ((a - b) ** 2).sum())
