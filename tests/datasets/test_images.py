"""Decoding image files: against what another library reads, and what may be wrong with a file."""

import json
import struct
from pathlib import Path

import numpy as np
import OpenEXR
import PIL.Image
import pytest
from picture_files import exr, exr_of, from_rgbe, hdr, rgbe

from addon.datasets.images.decoding import decode
from addon.datasets.images.grey import read_grey
from addon.errors import NacreError

FIXTURES = Path(__file__).resolve().parents[1] / "fixtures" / "datasets"
INDEPENDENT = json.loads((FIXTURES / "independent_images.json").read_text())["pictures"]
NM = tuple(float(nm) for nm in range(400, 701, 50))


@pytest.mark.parametrize("name", list(INDEPENDENT))
def test_another_library_reads_the_same(name):
    image = decode((FIXTURES / "images" / name).read_bytes(), name)
    expected = np.array(INDEPENDENT[name])
    bands = {"bands.exr": NM, "half_xyz.exr": "XYZ"}
    assert image.bands == bands.get(name, "RGB")
    if name == "rgb_16.png":
        np.testing.assert_array_equal(image.pixels, np.rint(expected * 65535).astype(int) >> 8)
        assert image.notes == ("of 16-bit colours the upper 8 bits read",)
    elif name == "grey_16.png":
        assert image.pixels.dtype == np.uint16
        expected = np.repeat(expected, 3, axis=2)
        np.testing.assert_array_equal(image.pixels, np.rint(expected * 65535))
    else:
        np.testing.assert_allclose(image.pixels, expected, rtol=1e-6)
        assert image.fits_half == (name not in ("float_piz.exr", "bands.exr"))


def pixels(height=4, width=9, seed=0):
    values = np.random.default_rng(seed).lognormal(0, 3, (height, width, 3))
    values[0, :5] = values[0, 0]
    values[1] = 0
    return rgbe(values)


@pytest.mark.parametrize(
    ("runs", "width"), [(True, 8), (True, 300), (False, 1), (False, 7), (False, 8), (False, 300)]
)
def test_radiance_rows_flat_and_in_runs(runs, width):
    """Rows of fewer than 8 pixels are never in runs."""
    picture = pixels(width=width)
    image = decode(hdr(picture, runs=runs), "a.hdr")
    np.testing.assert_array_equal(image.pixels, from_rgbe(picture))


def test_radiance_repeated_pixels():
    """The older encoding: 1, 1, 1, n repeats n times, and once more n times 256 times."""
    start = b"#?RGBE\n\n-Y 2 +X 300\n"
    row = bytes([9, 8, 7, 130]) + bytes([1, 1, 1, 43]) + bytes([1, 1, 1, 1])
    other = bytes([5, 4, 3, 128]) * 299 + bytes([6, 6, 6, 129])
    image = decode(start + row + other, "a.hdr")
    np.testing.assert_array_equal(image.pixels[0] / 2.0**-6, np.full((300, 3), [9, 8, 7]))
    np.testing.assert_array_equal(image.pixels[1, 0], np.array([5, 4, 3]) / 256)
    np.testing.assert_array_equal(image.pixels[1, 299], np.array([6, 6, 6]) / 128)


@pytest.mark.parametrize(
    ("size", "upward"), [("-Y 4 +X 9", False), ("+Y 4 +X 9", True), ("+X 9 -Y 4", True)]
)
def test_radiance_orientations(size, upward):
    """The last is ATRIUM's."""
    picture = pixels()
    image = decode(hdr(picture, size), "a.hdr")
    expected = from_rgbe(picture)
    np.testing.assert_array_equal(image.pixels, expected[::-1] if upward else expected)


def test_radiance_exposure_is_divided_out():
    picture = pixels()
    header = "EXPOSURE=2\nSOFTWARE=camera = 3\nEXPOSURE= 4\nCOLORCORR=1 0.5 2\n"
    image = decode(hdr(picture, header=header), "a.hdr")
    np.testing.assert_allclose(image.pixels, from_rgbe(picture) / [8, 4, 16], rtol=1e-6)
    assert image.pixels.dtype == np.float32
    assert image.notes == ("divided by the exposure in the images' headers, 8 4 16 in the first",)


def test_radiance_xyz():
    data = hdr(pixels()).replace(b"rgbe", b"xyze")
    assert decode(data, "a.hdr").bands == "XYZ"


WHOLE = hdr(pixels())
START = WHOLE.index(b"\2\2\0\x09")


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (WHOLE[:30], "no whole Radiance picture"),
        (b"#?RADIANCE\n" + b"A=1\n" * 20000, "no whole Radiance picture"),
        (WHOLE.replace(b"rgbe", b"rgb9"), "unknown FORMAT '32-bit_rle_rgb9'"),
        (hdr(pixels(), header="EXPOSURE=0\n"), "has the exposure 0"),
        (hdr(pixels(), header="EXPOSURE=nan\n"), "has the exposure nan"),
        (hdr(pixels(), header="EXPOSURE=big\n"), "unknown EXPOSURE 'big'"),
        (hdr(pixels(), "-Y 4 -X 9"), "has the size '-Y 4 -X 9'; expected"),
        (hdr(pixels(), "-Y 4"), "has the size '-Y 4'; expected"),
        (hdr(pixels(), "-Y 0 +X 9"), "has no pixels"),
        (hdr(pixels(), "-Y 4 +X 10000"), "claims 10000 x 4 pixels"),
        (hdr(pixels(), "-Y 8000 +X 8000"), "claims 8000 x 8000 pixels, but has"),
        (hdr(pixels(), "-Y 4 +X 10"), "a row of another width"),
        (WHOLE[: START + 4] + b"\0\0" + WHOLE[START + 6 :], "a run of no length"),
        (WHOLE[: START + 4] + b"\x90\0" + WHOLE[START + 6 :], "a run goes beyond its row"),
        (b"#?RADIANCE\n\n-Y 1 +X 2\n" + b"\1\1\1\2" * 2, "a run goes beyond its row"),
        (b"#?RADIANCE\n\n-Y 1 +X 2\n" + b"\2\1\1\2" + b"\1\1\1\2", "a run goes beyond its row"),
        *((WHOLE[:end], "cut short") for end in range(START, len(WHOLE), 7)),
        (hdr(pixels(), runs=False)[:-1], "cut short"),
    ],
)
def test_a_damaged_radiance_picture_is_one_clear_error(data, says):
    with pytest.raises(NacreError, match=says) as caught:
        decode(data, "a.hdr")
    assert str(caught.value).startswith("a.hdr")
    assert "\n" not in str(caught.value)


def test_radiance_values_beyond_any_number_are_refused():
    with pytest.raises(NacreError, match="a.hdr has values that are not finite numbers"):
        decode(hdr(np.full((1, 8, 4), 255, np.uint8), header="EXPOSURE=1e-9\n"), "a.hdr")


FLOATS = np.random.default_rng(4).random((5, 6, 3)).astype(np.float16)


@pytest.mark.parametrize("name", ["Y", "400", "w550nm", "S0.550,5nm", "wavelength_612.5"])
def test_exr_channels(name):
    """Of one channel: grey, or too few bands for a spectrum."""
    planes = {name: FLOATS[..., 0]}
    if name == "Y":
        image = decode(exr(planes), "a.exr")
        np.testing.assert_array_equal(image.pixels, np.repeat(FLOATS[..., :1], 3, axis=2))
        return
    with pytest.raises(NacreError, match=f"a.exr has the channels {name}; expected R, G, B"):
        decode(exr(planes), "a.exr")
    others = {"300nm": FLOATS[..., 1], "T.1000,0nm": FLOATS[..., 2], "A": FLOATS[..., 0]}
    image = decode(exr(planes | others), "a.exr")
    nm = {"400": 400, "w550nm": 550, "S0.550,5nm": 550.5, "wavelength_612.5": 612.5}[name]
    assert image.bands == (300, nm, 1000)
    np.testing.assert_array_equal(image.pixels, FLOATS[..., [1, 0, 2]])


def test_exr_colours_among_other_channels():
    planes = {name: FLOATS[..., i % 3] for i, name in enumerate("RGBAZ")}
    image = decode(exr(planes), "a.exr")
    assert image.bands == "RGB"
    np.testing.assert_array_equal(image.pixels, FLOATS)


def crop():
    corner = np.array([9, 9], np.int32)
    return exr_of(FLOATS, displayWindow=(np.array([0, 0], np.int32), corner))


def claiming(width):
    """An OpenEXR file whose header promises more columns than it has."""
    data = bytearray(exr_of(FLOATS))
    for window in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        at = data.index(window) + len(window) + 4
        struct.pack_into("<i", data, at + 8, width - 1)
    return bytes(data)


def two_parts(folder):
    plane = {"Y": FLOATS[..., 0].copy()}
    parts = [OpenEXR.Part({"type": OpenEXR.scanlineimage}, plane, name) for name in "ab"]
    OpenEXR.File(parts).write(str(folder / "b.exr"))
    return (folder / "b.exr").read_bytes()


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (exr_of(FLOATS, "ABC"), "has the channels A, B, C; expected"),
        (exr_of(FLOATS, ("A", "B\n", "C")), r"has the channels A, 'B\\n', C; expected"),
        (exr_of(FLOATS, ("400", "400nm", "500")), "several channels of one wavelength"),
        (exr_of(FLOATS.astype(np.uint32)), "whole numbers as pixels"),
        (exr_of(np.where(FLOATS < 0.1, np.nan, FLOATS)), "values that are not finite"),
        (crop(), "is a crop of a larger picture"),
        (two_parts, "has 2 parts"),
        (claiming(10000), "claims 10000 x 5 pixels"),
        (claiming(2**31 - 1), "(claims|cannot be read)"),
        (b"\x76\x2f\x31\x01" + bytes(50), "cannot be read as an OpenEXR picture"),
    ],
)
def test_an_exr_picture_that_cannot_be_read_is_one_clear_error(data, says, tmp_path, capfd):
    with pytest.raises(NacreError, match=says) as caught:
        decode(data(tmp_path) if callable(data) else data, "a.exr")
    assert str(caught.value).startswith("a.exr")
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("compression", [OpenEXR.NO_COMPRESSION, OpenEXR.ZIP_COMPRESSION])
def test_an_exr_picture_cut_short_is_one_clear_error(compression, capfd):
    data = exr_of(np.repeat(FLOATS, 9, axis=0), compression=compression)
    decode(data, "a.exr")
    for end in range(4, len(data), 31):
        with pytest.raises(NacreError, match="^a.exr (cannot be read as|is damaged or cut)"):
            decode(data[:end], "a.exr")
    assert capfd.readouterr() == ("", "")


def test_bmp():
    """Bottom row first, blue first, rows filled up to four bytes."""
    rows = [[(0, 0, 255), (10, 20, 30)], [(255, 0, 0), (0, 255, 0)]]
    body = b"".join(bytes(v for pixel in row for v in pixel[::-1]) + bytes(2) for row in rows)
    header = struct.pack("<2sI4xI", b"BM", 54 + len(body), 54)
    info = struct.pack("<IiiHHIIiiII", 40, 2, 2, 1, 24, 0, len(body), 0, 0, 0, 0)
    image = decode(header + info + body, "a.bmp")
    np.testing.assert_array_equal(image.pixels, rows[::-1])


@pytest.mark.parametrize("kind", ["uint8", "uint16", "exr"])
def test_grey_pictures_are_numbers_from_0_to_1(tmp_path, kind):
    rows = np.array([[0, 51], [102, 255], [255, 204]], np.uint16)
    path = tmp_path / "mask"
    if kind == "exr":
        path.write_bytes(exr({"Y": (rows / 255).astype(np.float32)}))
    else:
        whole = rows * (np.iinfo(kind).max // 255)
        PIL.Image.fromarray(whole.astype(kind)).save(path, "PNG")
    np.testing.assert_allclose(read_grey(path), rows[::-1] / 255, atol=1e-6)


def test_what_is_no_mask_is_refused(tmp_path):
    path = tmp_path / "mask"
    with pytest.raises(NacreError, match="mask: cannot be read"):
        read_grey(path)
    PIL.Image.fromarray(np.full((2, 2, 3), (1, 2, 3), np.uint8)).save(path, "PNG")
    with pytest.raises(NacreError, match="coloured"):
        read_grey(path)
    path.write_bytes(exr({"Y": np.full((2, 2), 1.5, np.float32)}))
    with pytest.raises(NacreError, match="outside 0 to 1"):
        read_grey(path)
