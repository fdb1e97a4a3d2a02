"""Sets of images named by their angles besides UBO2003's: ATRIUM's HDR, UTIA's, Bonn's spectral."""

import json
import os
import sys

import numpy as np
import pytest
from image_zips import (
    LIGHTS,
    VIEWS,
    encode,
    random_floats,
    random_images,
    samples_of,
    usual_files,
    usual_name,
    write_zip,
)
from picture_files import exr_of, from_rgbe, hdr, rgbe

from addon.datasets.colour import spectrum_to_rec709, srgb_to_linear, xyz_to_rec709
from addon.datasets.images import grid as image_grid
from addon.datasets.importing import describe_source, detect_format, import_dataset
from addon.datasets.options import Options
from addon.datasets.utia import open_source
from addon.errors import NacreError

COSINES = np.cos(np.radians([theta for theta, _ in LIGHTS]))[:, None, None, None, None]
NM = (420.0, 500.0, 580.0, 660.0)


def utia_name(light, view, suffix=".png"):
    (tl, pl), (tv, pv) = light, view
    return f"tv{tv:03}_pv{pv:03}/tl{tl:03}_pl{pl:03}_tv{tv:03}_pv{pv:03}{suffix}"


def spectral_name(light, view):
    (tl, pl), (tv, pv) = light, view
    return f"tv{tv:f}_pv{pv:f}_tl{tl:f}_pl{pl:f}.exr"


def utia_png():
    return {utia_name(*pair): encode(pixels) for pair, pixels in random_images().items()}


def utia_exr():
    images = random_floats()
    half = {pair: pixels.astype(np.float16) for pair, pixels in images.items()}
    return half, {utia_name(*pair, ".exr"): exr_of(pixels) for pair, pixels in half.items()}


def spectral():
    images = random_floats(bands=len(NM))
    names = [f"{nm:g}nm" for nm in NM]
    return images, {spectral_name(*pair): exr_of(pixels, names) for pair, pixels in images.items()}


def atrium():
    images = {pair: rgbe(pixels) for pair, pixels in random_floats().items()}
    files = {
        usual_name(*pair, ".hdr"): hdr(pixels, size="+X 8 -Y 3") for pair, pixels in images.items()
    }
    # Rows from the bottom, as ATRIUM's are.
    return {pair: from_rgbe(pixels[::-1]) for pair, pixels in images.items()}, files


def imported(folder, files, **options):
    return import_dataset(write_zip(folder / "cloth.zip", files), folder / "a.nacre", **options)


def test_atrium_hdr(tmp_path):
    images, files = atrium()
    dataset = imported(tmp_path, files)
    assert dataset.source["format"] == "ubo2003"
    assert dataset.samples.dtype == np.float16
    np.testing.assert_allclose(dataset.samples, samples_of(images), rtol=1e-3, atol=1e-6)
    assert "float values taken as linear" in dataset.source["conversions"]


def test_utia_png(tmp_path):
    dataset = imported(tmp_path, utia_png())
    assert dataset.source["format"] == "utia"
    expected = srgb_to_linear(samples_of(random_images()) / 255.0)
    np.testing.assert_allclose(dataset.samples, expected, rtol=1e-3, atol=1e-6)
    assert "8-bit values decoded as sRGB" in dataset.source["conversions"]
    assert "colours taken as Rec.709" in dataset.source["conversions"]


def test_utia_exr(tmp_path):
    images, files = utia_exr()
    dataset = imported(tmp_path, files)
    assert dataset.source["format"] == "utia"
    assert dataset.samples.dtype == np.float16
    expected = samples_of(images).astype(float) @ xyz_to_rec709().T
    np.testing.assert_allclose(dataset.samples, expected, rtol=1e-3, atol=2e-3)
    assert "CIE XYZ (D65) converted to Rec.709" in dataset.source["conversions"]
    assert "float values taken as linear" in dataset.source["conversions"]


@pytest.mark.parametrize(
    ("text", "moved"),
    [
        ("1 0 0 5 90\n2 15 0 15 0\n", True),
        ("1, 0, 0, 5, 90\r\n\r\n2, 15, 0, 15, 0\r\n", True),
        ("1 0 0 0 0\n2 15 0 15 0\n", False),
        ("1 0 0\n2 15 0\n", False),
        ("hello, this is UTIA BTF\n", False),
    ],
)
def test_utias_moved_lights_are_recorded(tmp_path, text, moved):
    dataset = imported(tmp_path, {"list.txt": text.encode(), **utia_png()})
    found = [line for line in dataset.source["conversions"] if "as list.txt lists" in line]
    assert len(found) == moved
    # The lights are where the names have them.
    np.testing.assert_allclose(dataset.light[:, 2], COSINES.ravel())


def test_spectra(tmp_path):
    images, files = spectral()
    dataset = imported(tmp_path, files)
    assert dataset.source["format"] == "spectral"
    assert dataset.samples.dtype == np.float32
    expected = samples_of(images) @ spectrum_to_rec709(NM).T
    np.testing.assert_allclose(dataset.samples, expected, rtol=1e-5, atol=1e-6)
    (line,) = (line for line in dataset.source["conversions"] if "spectra" in line)
    assert "4 bands from 420 to 660 nm, seen under D65" in line


def test_a_flat_spectrum_is_white(tmp_path):
    ones = np.ones((3, 8, len(NM)), np.float16)
    files = {name: exr_of(ones, [f"{nm:g}" for nm in NM]) for name in spectral()[1]}
    np.testing.assert_array_equal(imported(tmp_path, files).samples, 1)


@pytest.mark.parametrize("make", [atrium, utia_exr, spectral])
def test_white_cosine_and_patch_width(tmp_path, make):
    images, files = make()
    (tmp_path / "plain").mkdir()
    plain = imported(tmp_path / "plain", files)
    dataset = imported(tmp_path, files, white=2.5, cosine=0, patch_width=0.04)
    expected = plain.samples.astype(np.float32) / 2.5 * COSINES
    np.testing.assert_allclose(dataset.samples, expected, rtol=2e-3, atol=1e-3)
    assert dataset.patch_size == pytest.approx((0.04, 0.015))
    for line in (
        "divided by 2.5, a white diffuser lit head-on, as asked",
        "multiplied by cos(theta_light), as asked",
        "patch taken as 0.04 m wide, as asked",
    ):
        assert line in dataset.source["conversions"]


@pytest.mark.parametrize(
    ("gamma", "expected", "line"),
    [
        (1.8, lambda v: v**1.8, "8-bit values decoded with gamma 1.8, as asked"),
        (1, lambda v: v, "8-bit values taken as linear, as asked"),
        ("srgb", srgb_to_linear, "8-bit values decoded as sRGB, as asked"),
    ],
)
def test_gamma(tmp_path, gamma, expected, line):
    dataset = imported(tmp_path, usual_files(), gamma=gamma)
    values = expected(samples_of(random_images()) / 255.0)
    np.testing.assert_allclose(dataset.samples, values, rtol=1e-3, atol=1e-6)
    assert line in dataset.source["conversions"]


def test_gamma_of_floats_and_colour_space(tmp_path):
    images, files = utia_exr()
    dataset = imported(tmp_path, files, gamma=2.0, colour_space="rec709")
    expected = samples_of(images).astype(float) ** 2
    np.testing.assert_allclose(dataset.samples, expected, rtol=2e-3)
    assert "float values decoded with gamma 2, as asked" in dataset.source["conversions"]
    assert "colours taken as Rec.709, as asked" in dataset.source["conversions"]


def test_colours_of_8_bits_may_be_xyz(tmp_path):
    dataset = imported(tmp_path, usual_files(), colour_space="xyz", format="ubo2003")
    expected = (samples_of(random_images()) / 255.0) ** 2.2 @ xyz_to_rec709().T
    np.testing.assert_allclose(dataset.samples, expected, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"gamma": 0}, "gamma must be a number above 0, not 0"),
        ({"gamma": "pq"}, "gamma must be a number above 0, not pq"),
        ({"white": -1.0}, "white must be a number above 0"),
        ({"patch_width": float("nan")}, "patch_width must be a number above 0"),
        ({"colour_space": "lab"}, "colour_space must be rec709 or xyz, not lab"),
        ({"lights": "ubo81"}, "is read as utia, which takes no --lights"),
    ],
)
def test_options_that_make_no_sense(tmp_path, options, says):
    path = write_zip(tmp_path / "cloth.zip", utia_png())
    with pytest.raises(NacreError, match=says):
        describe_source(path, **options)


@pytest.mark.parametrize(
    ("make", "format"),
    [(atrium, "ubo2003"), (utia_exr, "utia"), (spectral, "spectral")],
)
def test_content_tells_them_apart_in_folders_too(tmp_path, make, format):
    _, files = make()
    for name, data in files.items():
        (tmp_path / "set" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "set" / name).write_bytes(data)
    assert detect_format(tmp_path / "set") == format
    summary = describe_source(tmp_path / "set")
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert (summary["light"], summary["view"]) == (3, 2)
    assert (summary["width"], summary["height"]) == (8, 3)
    assert summary["bytes"] == sum(map(len, files.values()))
    assert os.listdir(tmp_path) == ["set"]


def changed(make, pair, data):
    images, files = make()
    name = list(files)[list(images).index(pair)]
    return files | {name: data(images[pair])}


LAST = (LIGHTS[2], VIEWS[1])


@pytest.mark.parametrize(
    ("files", "says"),
    [
        (changed(atrium, LAST, lambda _: hdr(rgbe(np.ones((3, 8, 3))))[:-3]), "pv090.hdr is cut"),
        (
            changed(utia_exr, LAST, lambda image: exr_of(image)[:-40]),
            "tl015_pl180_tv030_pv090.exr (is damaged|cannot be read)",
        ),
        (
            changed(utia_exr, LAST, lambda image: exr_of(image.astype(np.float32))),
            "pv090.exr is another kind of image than .*tl000_pl000_tv000_pv000.exr",
        ),
        (
            changed(spectral, LAST, lambda image: exr_of(image, ("420", "500", "580", "661"))),
            "tv30.000000_pv90.000000_tl15.000000_pl180.000000.exr is another kind",
        ),
        (
            changed(utia_exr, LAST, lambda image: exr_of(image[:2])),
            "pv090.exr has 8 x 2 pixels, but .* has 8 x 3",
        ),
        (
            changed(atrium, LAST, lambda _: usual_files()[usual_name(*LAST)]),
            "pv090.hdr has 4 x 3 pixels",
        ),
    ],
)
def test_a_bad_image_is_one_clear_error_and_leaves_nothing(tmp_path, files, says, capfd):
    with pytest.raises(NacreError, match=says) as caught:
        imported(tmp_path, files)
    assert "\n" not in str(caught.value)
    assert os.listdir(tmp_path) == ["cloth.zip"]
    assert capfd.readouterr() == ("", "")


def test_a_spectrum_must_be_one(tmp_path):
    path = write_zip(tmp_path / "cloth.zip", utia_exr()[1])
    with pytest.raises(NacreError, match="is no OpenEXR image with a channel a wavelength"):
        describe_source(path, format="spectral")


def test_values_beyond_half_floats_are_kept(tmp_path):
    bright = rgbe(np.full((3, 8, 3), 1e6))
    dataset = imported(tmp_path, {name: hdr(bright) for name in atrium()[1]})
    assert dataset.samples.dtype == np.float32
    np.testing.assert_allclose(dataset.samples, 1e6, rtol=0.01)


def test_what_becomes_infinite_is_one_clear_error(tmp_path):
    bright = np.full((3, 8, 3), 3e38, np.float32)
    files = {name: exr_of(bright) for name in utia_exr()[1]}
    with pytest.raises(
        NacreError, match="the value at light 0, view 0, y 0, x 0, channel 0 is not"
    ):
        imported(tmp_path, files)


def test_few_images_are_held_at_a_time(tmp_path, monkeypatch):
    """Two lights' worth of views do not fit into a block here, nor do two views."""
    images, files = utia_exr()
    source = open_source(write_zip(tmp_path / "cloth.zip", files), Options())
    shape = (1, *source.shape[2:])
    whole = np.concatenate(list(source.blocks()))
    monkeypatch.setattr(image_grid, "BLOCK_BYTES", 4 * np.prod(shape) + 4)
    blocks = list(source.blocks())
    assert [block.shape for block in blocks] == [shape] * len(images)
    np.testing.assert_array_equal(np.concatenate(blocks), whole)


def test_without_openexr_it_is_said_what_to_install(tmp_path, monkeypatch):
    path = write_zip(tmp_path / "cloth.zip", utia_exr()[1])
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with pytest.raises(NacreError, match="needs the Python package OpenEXR: install it"):
        describe_source(path)
