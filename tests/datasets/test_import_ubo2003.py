import io
import os
import struct
import sys
import zipfile
import zlib

import numpy as np
import pytest
from image_zips import (
    LIGHTS,
    VIEWS,
    encode,
    random_images,
    usual_files,
    usual_name,
    write_zip,
)
from PIL import Image

from addon.datasets.directions import spherical_to_unit
from addon.datasets.importing import describe_source, detect_format, import_dataset
from addon.errors import NacreError


def expected():
    """Samples (light, view, y, x, channel): linear, bottom row first."""
    images = random_images()
    return np.array([[(images[li, v][::-1] / 255.0) ** 2.2 for v in VIEWS] for li in LIGHTS])


def imported(folder, files, **options):
    path = write_zip(folder / "cloth.zip", files)
    return import_dataset(path, folder / "cloth.nacre", **options)


def assert_refused(folder, files, says):
    path = write_zip(folder / "cloth.zip", files) if isinstance(files, dict) else files
    with pytest.raises(NacreError, match=says) as caught:
        import_dataset(path, folder / "cloth.nacre")
    assert "\n" not in str(caught.value)
    assert os.listdir(folder) == ["cloth.zip"]


def test_a_usual_zip(tmp_path):
    dataset = imported(tmp_path, usual_files())
    assert dataset.samples.dtype == np.float16
    np.testing.assert_allclose(dataset.samples, expected(), rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(dataset.light, spherical_to_unit([0, 15, 15], [0, 0, 180]))
    np.testing.assert_allclose(dataset.view, spherical_to_unit([0, 30], [0, 90]))
    assert dataset.patch_size == pytest.approx((0.01, 0.0075))
    assert dataset.source["format"] == "ubo2003"
    assert dataset.source["file"] == "cloth.zip"
    assert any("gamma 2.2" in line for line in dataset.source["conversions"])
    assert any("include cos" in line for line in dataset.source["conversions"])


def test_jpeg_images(tmp_path):
    files = usual_files(".jpg")
    dataset = imported(tmp_path, files)
    data = files[usual_name(LIGHTS[1], VIEWS[1], ".jpg")]
    pixels = np.asarray(Image.open(io.BytesIO(data)))
    linear = (pixels[::-1] / 255.0) ** 2.2
    np.testing.assert_allclose(dataset.samples[1, 1], linear, rtol=1e-3, atol=1e-6)


def test_the_cosine_can_be_multiplied_in(tmp_path):
    dataset = imported(tmp_path, usual_files(), cosine=0)
    cosines = np.cos(np.radians([theta for theta, _ in LIGHTS]))[:, None, None, None, None]
    np.testing.assert_allclose(dataset.samples, expected() * cosines, rtol=1e-3, atol=1e-6)
    assert any("multiplied by cos" in line for line in dataset.source["conversions"])


@pytest.mark.parametrize(
    "name",
    [
        "tl{tl:03} pl{pl:03} tv{tv:03} pv{pv:03}.png",
        "tl{tl:03}_pl{pl:03}__tv{tv:03}_pv{pv:03}.PNG",
        "tv{tv}pv{pv}tl{tl}pl{pl}.png",
        "a/b/img_tv_{tv}_pv_{pv}_tl_{tl}_pl_{pl}.png",
        "TL{tl:.1f} PL{pl:.2f} TV{tv:.1f} PV{pv:.1f}.png",
        "apl7 tl{tl} pl{pl} tv{tv} pv{pv}.png",
        "tl{tl:+} pl{pl_back} tv{tv} pv{pv}.png",
    ],
)
def test_angles_in_any_order_and_spelling(tmp_path, name):
    files = {
        name.format(tl=li[0], pl=li[1], pl_back=li[1] - 360, tv=v[0], pv=v[1]): encode(pixels)
        for (li, v), pixels in random_images().items()
    }
    np.testing.assert_allclose(imported(tmp_path, files).samples, expected(), rtol=1e-3, atol=1e-6)


def test_any_grid_with_fractions_of_a_degree(tmp_path):
    files = {
        f"tl{tl} pl0 tv{tv} pv7.5.png": encode(np.full((2, 2, 3), 100, np.uint8))
        for tl in (11, 23.5, 37.5)
        for tv in (5, 2.5, 52.5, 60)
    }
    dataset = imported(tmp_path, files)
    np.testing.assert_allclose(dataset.light, spherical_to_unit([11, 23.5, 37.5], [0] * 3))
    np.testing.assert_allclose(dataset.view, spherical_to_unit([2.5, 5, 52.5, 60], [7.5] * 4))


def test_what_is_no_image_is_passed_over(tmp_path):
    files = {
        "readme.txt": b"hello",
        "folder/": b"",
        "__MACOSX/._tl0.png": b"junk",
        "a/.DS_Store": b"junk",
        "a/._00000 tl000 pl000 tv000 pv000.png": b"junk",
        **usual_files(),
    }
    assert imported(tmp_path, files).shape == (3, 2, 3, 4, 3)


def test_nothing_is_unpacked(tmp_path):
    files = {"../../evil tl80 pl0 tv0 pv0.txt": b"", **usual_files()}
    imported(tmp_path, files)
    assert sorted(os.listdir(tmp_path)) == ["cloth.nacre", "cloth.zip"]


def test_a_folder_is_read_like_a_zip(tmp_path):
    folder = tmp_path / "pictures"
    for name, data in usual_files().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    (folder / "notes.txt").touch()
    assert detect_format(folder) == "ubo2003"
    dataset = import_dataset(folder, tmp_path / "cloth.nacre")
    np.testing.assert_allclose(dataset.samples, expected(), rtol=1e-3, atol=1e-6)


def test_the_content_decides_not_the_extension(tmp_path):
    path = write_zip(tmp_path / "cloth.dat", usual_files())
    assert detect_format(path) == "ubo2003"


@pytest.mark.parametrize("mode", ["L", "RGBA", "P"])
def test_other_kinds_of_8_bit_images(tmp_path, mode):
    pixels = np.repeat(np.arange(12, dtype=np.uint8).reshape(3, 4, 1) * 20, 3, axis=2)
    buffer = io.BytesIO()
    Image.fromarray(pixels).convert("L").convert(mode).save(buffer, "PNG")
    dataset = imported(tmp_path, {"tl0 pl0 tv0 pv0.png": buffer.getvalue()})
    linear = (pixels[::-1] / 255.0) ** 2.2
    np.testing.assert_allclose(dataset.samples[0, 0], linear, rtol=1e-3, atol=1e-6)


def test_summary(tmp_path):
    path = write_zip(tmp_path / "cloth.zip", usual_files())
    summary = describe_source(path)
    assert summary["format"] == "ubo2003"
    assert (summary["light"], summary["view"]) == (3, 2)
    assert (summary["width"], summary["height"]) == (4, 3)
    assert summary["samples_bytes"] == 3 * 2 * 3 * 4 * 3 * 2
    assert summary["bytes"] == path.stat().st_size
    assert summary["colour_model"] is summary["cosine_flag"] is summary["components"] is None
    assert os.listdir(tmp_path) == ["cloth.zip"]


def without(name):
    return {key: data for key, data in usual_files().items() if key != name}


ONE = usual_name(LIGHTS[2], VIEWS[1])


@pytest.mark.parametrize(
    ("files", "says"),
    [
        ({}, "holds no images"),
        ({"readme.txt": b"hello"}, "holds no images"),
        (without(ONE), "cloth.zip lacks the image for tl 15 pl 180 tv 30 pv 90: 3 lights by 2"),
        (
            {**usual_files(), "tl40 pl0 tv0 pv0.png": b""},
            r"lacks the image for tl 40 pl 0 tv 30 pv 90: 4 lights",
        ),
        (
            {**usual_files(), "tl40 pl0 tv50 pv0.png": b""},
            r"lacks the image .* \(and 2 more\)",
        ),
        ({**usual_files(), "cover.jpg": b""}, "cover.jpg has no angles in its name"),
        ({**usual_files(), "tl0 pl0 tv0.png": b""}, "tl0 pl0 tv0.png has no angles"),
        ({**usual_files(), f"tl{'9' * 400} pl0 tv0 pv0.png": b""}, "must be finite"),
        ({**usual_files(), "tl120 pl0 tv0 pv0.png": b""}, "theta 120 points below the surface"),
        ({**usual_files(), "tl15 pl540 tv30 pv90.png": b""}, "have the same angles"),
        ({**usual_files(), "tl0 pl0 tv0 pv0.tif": b""}, "pv0.tif is of a kind of image that"),
        ({**usual_files(), ONE: b"not an image"}, "pl180 tv030 pv090.png cannot be read as"),
        ({**usual_files(), ONE: usual_files()[ONE][:60]}, "pl180 tv030 pv090.png cannot be read"),
        (
            {**usual_files(), ONE: encode(np.zeros((4, 4, 3), np.uint8))},
            "pl180 tv030 pv090.png has 4 x 4 pixels, but .* has 4 x 3",
        ),
    ],
)
def test_a_zip_that_cannot_be_read_is_one_clear_error(tmp_path, files, says):
    assert_refused(tmp_path, files, says)


def test_an_image_listed_twice_is_an_error(tmp_path):
    path = write_zip(tmp_path / "cloth.zip", usual_files())
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr(ONE, b"")
    assert_refused(tmp_path, path, "have the same angles")


def png_claiming(width, height):
    """A PNG whose header promises more pixels than it has."""

    def chunk(kind, data):
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    header = struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)
    pixels = zlib.compress(bytes(100))
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize(
    ("size", "says"),
    [((9000, 2), "claims 9000 x 2 pixels"), ((2**31 - 1, 2**31 - 1), "cannot be read as an image")],
)
def test_an_image_of_absurd_size_is_not_decoded(tmp_path, size, says):
    first = {usual_name(LIGHTS[0], VIEWS[0]): png_claiming(*size)}
    assert_refused(tmp_path, {**usual_files(), **first}, says)


def test_a_cmyk_image_is_refused(tmp_path):
    buffer = io.BytesIO()
    Image.new("CMYK", (4, 3)).save(buffer, "JPEG")
    assert_refused(tmp_path, {"tl0 pl0 tv0 pv0.jpg": buffer.getvalue()}, "has CMYK pixels")


def test_a_zip_bomb_is_not_unpacked(tmp_path):
    path = write_zip(tmp_path / "cloth.zip", {"tl0 pl0 tv0 pv0.png": bytes(10)})
    data = bytearray(path.read_bytes())
    entry = data.index(b"PK\1\2")
    struct.pack_into("<I", data, entry + 24, 2**31)  # the unpacked size in the directory
    path.write_bytes(data)
    assert_refused(tmp_path, path, "too large for an image")


def test_a_zip_cut_short_is_one_clear_error(tmp_path):
    data = write_zip(tmp_path / "cloth.zip", usual_files()).read_bytes()
    for cut in range(0, len(data), 101):
        (tmp_path / "cloth.zip").write_bytes(data[:cut])
        assert_refused(tmp_path, tmp_path / "cloth.zip", "is not a zip file or is cut short")


def test_without_pillow_it_is_said_what_to_install(tmp_path, monkeypatch):
    path = write_zip(tmp_path / "cloth.zip", usual_files())
    monkeypatch.setitem(sys.modules, "PIL", None)
    assert_refused(tmp_path, path, "needs the Python package Pillow")
