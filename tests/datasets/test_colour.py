"""Spectra and CIE XYZ to linear Rec.709, against the library colour-science."""

import json
from pathlib import Path

import numpy as np
import pytest

from addon.datasets.colour import spectrum_to_rec709, srgb_to_linear, xyz_to_rec709

FIXTURES = Path(__file__).resolve().parents[1] / "fixtures" / "datasets"
INDEPENDENT = json.loads((FIXTURES / "independent_images.json").read_text())


@pytest.mark.parametrize("entry", INDEPENDENT["spectra"])
def test_spectra_as_colour_science_has_them(entry):
    """It has a white of its own for D65, 2e-4 off the one that Rec.709 is defined with."""
    ours = spectrum_to_rec709(entry["nm"]) @ entry["values"]
    np.testing.assert_allclose(ours, entry["rgb"], atol=3e-4)


@pytest.mark.parametrize("entry", INDEPENDENT["xyz"])
def test_xyz_as_colour_science_has_it(entry):
    np.testing.assert_allclose(xyz_to_rec709() @ entry["xyz"], entry["rgb"], atol=1e-6)


@pytest.mark.parametrize("wavelengths", [range(400, 701, 10), (450, 550, 650), (300, 560.5, 1200)])
def test_a_flat_spectrum_is_white(wavelengths):
    white = spectrum_to_rec709(wavelengths) @ np.ones(len(wavelengths))
    np.testing.assert_allclose(white, 1, atol=1e-12)


def test_the_order_of_colours():
    """Long waves are red, short ones blue."""
    long, middle, short = (
        spectrum_to_rec709(range(400, 701, 10))
        @ [float(low <= nm < high) for nm in range(400, 701, 10)]
        for low, high in ((600, 701), (510, 570), (400, 480))
    )
    assert [int(np.argmax(rgb)) for rgb in (long, middle, short)] == [0, 1, 2]


def test_d65_white_of_xyz():
    white = np.array([0.3127 / 0.3290, 1, (1 - 0.3127 - 0.3290) / 0.3290])
    np.testing.assert_allclose(xyz_to_rec709() @ white, 1, atol=1e-12)


def test_srgb():
    """Both branches of the standard's curve, and its join."""
    encoded = [-0.1, 0, 0.04045, 0.0404501, 0.5, 1]
    linear = [0, 0, 0.0031308, 0.0031308, 0.2140411, 1]
    np.testing.assert_allclose(srgb_to_linear(encoded), linear, atol=1e-7)
