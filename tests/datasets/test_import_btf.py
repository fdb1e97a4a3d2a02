import itertools
import os
import struct
import tracemalloc

import numpy as np
import pytest
from btf_writer import BtfFile, lab_to_linear

from addon.datasets.bonn import contents
from addon.datasets.bonn.colour_models import ColourModel
from addon.datasets.directions import spherical_to_unit
from addon.datasets.importing import describe_source, detect_format, import_dataset
from addon.errors import NacreError


def save(folder, file):
    path = folder / "cloth.btf"
    path.write_bytes(file.to_bytes() if isinstance(file, BtfFile) else file)
    return path


def imported(folder, file, **options):
    return import_dataset(save(folder, file), folder / "cloth.nacre", **options)


def assert_refused(folder, file, says, **options):
    path = save(folder, file)
    with pytest.raises(NacreError, match=says) as caught:
        import_dataset(path, folder / "cloth.nacre", **options)
    assert "\n" not in str(caught.value)
    assert "cloth.btf" in str(caught.value)
    assert os.listdir(folder) == ["cloth.btf"]
    return str(caught.value)


@pytest.mark.parametrize(
    ("version", "model", "transposed"),
    list(itertools.product((1, 2, 3, 4), (0, 1, 3, 4, 5, 6, 9, 10, 11, 12), (False, True))),
)
def test_versions_and_colour_models(tmp_path, version, model, transposed):
    file = BtfFile(
        version=version,
        colour_model=model,
        transposed=transposed,
        scale=0.5,
        mean=(0.25, -0.5, 1.0),
        matrix=np.array([[1, 0.5, -0.25], [2, -1, 0.75], [0.125, 3, 1]]),
    )
    dataset = imported(tmp_path, file)
    assert dataset.samples.dtype == np.float32
    np.testing.assert_allclose(dataset.samples, file.expected(), rtol=2e-5, atol=2e-6)


def test_lab(tmp_path):
    file = BtfFile(colour_model=2, scale=20.0, texel_scale=1.0)
    dataset = imported(tmp_path, file)
    expected = file.expected()
    assert expected.max() > 0.1  # dark and light, on both sides of Lab's kink
    np.testing.assert_allclose(dataset.samples, expected, rtol=2e-3, atol=2e-5)


def test_lab_white_is_white():
    white = ColourModel(2, np.zeros(3), np.eye(3)).decode(np.array([[100.0], [0], [0]], np.float32))
    np.testing.assert_allclose(white, 1.0, atol=2e-4)
    np.testing.assert_allclose(lab_to_linear(100, 0, 0), 1.0, atol=1e-12)


@pytest.mark.parametrize("scalars", [(2, 2, 2), (4, 4, 4), (8, 8, 8), (2, 4, 8)])
def test_scalars(tmp_path, scalars):
    file = BtfFile(scalars=scalars)
    dataset = imported(tmp_path, file)
    half = scalars == (2, 2, 2)
    assert dataset.samples.dtype == (np.float16 if half else np.float32)
    np.testing.assert_allclose(
        dataset.samples, file.expected(), rtol=6e-4 if half else 1e-5, atol=1e-6
    )


def test_directions_patch_and_source(tmp_path):
    file = BtfFile()
    dataset = imported(tmp_path, file)
    for found, angles in ((dataset.light, file.light), (dataset.view, file.view)):
        theta, phi = np.degrees(np.array(angles)).T
        np.testing.assert_allclose(found, spherical_to_unit(theta, phi), atol=1e-7)
    assert dataset.patch_size == pytest.approx((5e-4, 4e-4))
    assert dataset.source == {"format": "btf", "file": "cloth.btf", "conversions": []}
    assert dataset.channels == ("R", "G", "B")


@pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, np.inf])
def test_a_useless_scale_is_replaced_and_recorded(tmp_path, scale):
    dataset = imported(tmp_path, BtfFile(pixels_per_mm=scale))
    assert dataset.patch_size == pytest.approx((0.01, 0.008))
    assert "no scale in the file" in dataset.source["conversions"][-1]


@pytest.mark.parametrize(
    ("version", "flag", "override", "multiplied", "recorded"),
    [
        (2, 1, None, False, None),
        (2, 0, None, True, "flag 0"),
        (1, 1, None, False, "version 1"),
        (1, 1, 0, True, "as asked"),
        (2, 1, 0, True, "as asked"),
        (2, 0, 1, False, "as asked"),
        (2, 7, 1, False, "as asked"),
    ],
)
def test_the_cosine(tmp_path, version, flag, override, multiplied, recorded):
    file = BtfFile(version=version, cosine_flag=flag)
    dataset = imported(tmp_path, file, cosine=override)
    np.testing.assert_allclose(
        dataset.samples, file.expected(times_cosine=multiplied), rtol=1e-5, atol=1e-6
    )
    conversions = " ".join(dataset.source["conversions"])
    assert (recorded in conversions) if recorded else not conversions


def test_an_unknown_cosine_flag_is_not_guessed(tmp_path):
    assert_refused(tmp_path, BtfFile(cosine_flag=7), "unknown cosine flag 7.*cosine 0 or 1")


def test_signature_without_rotations(tmp_path):
    file = BtfFile(signature=b"!DFMF08FC", version=4)
    dataset = imported(tmp_path, file)
    np.testing.assert_allclose(dataset.samples, file.expected(), rtol=1e-5, atol=1e-6)


def test_rotations_are_recorded_unless_they_are_none(tmp_path):
    identity = np.tile(np.eye(3), (4, 1, 1))
    assert imported(tmp_path, BtfFile(rotations=identity)).source["conversions"] == []
    turned = imported(tmp_path, BtfFile(rotations=identity[:, ::-1]))
    assert turned.source["conversions"] == ["rotations of local frames left out"]
    np.testing.assert_allclose(turned.samples, BtfFile().expected(), rtol=1e-5, atol=1e-6)


def test_unknown_additions_to_the_header_are_passed_over(tmp_path):
    file = BtfFile(version=4, added_to_header=b"something newer")
    dataset = imported(tmp_path, file)
    np.testing.assert_allclose(dataset.samples, file.expected(), rtol=1e-5, atol=1e-6)


def test_channels_are_put_in_order(tmp_path):
    file = BtfFile(version=4, channel_names=(b"Blue\0", b"green", b"RED"))
    dataset = imported(tmp_path, file)
    np.testing.assert_allclose(dataset.samples, file.expected()[..., ::-1], rtol=1e-5, atol=1e-6)
    # Y, U and V become red, green and blue, whatever they are called.
    for names in ((b"Blue", b"Green", b"Red"), (b"Y", b"U", b"V")):
        file = BtfFile(version=4, channel_names=names, colour_model=11)
        dataset = imported(tmp_path, file)
        np.testing.assert_allclose(dataset.samples, file.expected(), rtol=1e-5, atol=1e-6)


def test_the_patch_may_be_given(tmp_path):
    for scale in (0.0, 10.0):
        dataset = imported(tmp_path, BtfFile(pixels_per_mm=scale), patch_width=0.05)
        assert dataset.patch_size == pytest.approx((0.05, 0.04))
        assert dataset.source["conversions"] == ["patch taken as 0.05 m wide, as asked"]


def test_scale_factors_are_recorded(tmp_path):
    dataset = imported(tmp_path, BtfFile(rgb_scale=(1.0, 0.5, 2.0)))
    np.testing.assert_allclose(dataset.samples, BtfFile().expected(), rtol=1e-5, atol=1e-6)
    assert dataset.source["conversions"] == ["RGB scale factors 1, 0.5, 2 of the header left out"]


def test_as_many_texels_as_direction_pairs_means_not_transposed(tmp_path):
    file = BtfFile(width=3, height=2)
    dataset = imported(tmp_path, file)
    np.testing.assert_allclose(dataset.samples, file.expected(), rtol=1e-5, atol=1e-6)


def test_values_too_large_for_half_become_single_precision(tmp_path):
    file = BtfFile(scalars=(2, 2, 2), scale=1e4, texel_scale=10.0)
    assert np.abs(file.expected()).max() > 65504
    dataset = imported(tmp_path, file)
    assert dataset.samples.dtype == np.float32
    np.testing.assert_allclose(dataset.samples, file.expected(), rtol=1e-4, atol=1)
    assert sorted(os.listdir(tmp_path)) == ["cloth.btf", "cloth.nacre"]


def test_negative_values_are_kept(tmp_path):
    assert imported(tmp_path, BtfFile()).samples.min() < 0


def test_summary(tmp_path):
    file = BtfFile(colour_model=11, cosine_flag=0)
    path = save(tmp_path, file)
    assert detect_format(path) == "btf"
    summary = describe_source(path)
    assert summary["format"] == "btf"
    assert (summary["light"], summary["view"]) == (3, 2)
    assert (summary["width"], summary["height"]) == (5, 4)
    assert summary["colour_model"] == "11 (log Y, U/Y, V/Y)"
    assert summary["cosine_flag"] == 0
    assert summary["components"] == [3, 2, 1]
    assert summary["bytes"] == path.stat().st_size
    assert summary["samples_bytes"] == 3 * 2 * 4 * 5 * 3 * 4
    assert len(summary["conversions"]) == 2
    assert os.listdir(tmp_path) == ["cloth.btf"]


def test_blocks_are_bounded_and_contiguous(tmp_path, monkeypatch):
    directions = tuple((0.07 * i, 0.3 * i) for i in range(20))
    file = BtfFile(light=directions, view=directions, width=32, height=40, scalars=(2, 2, 2))
    path = save(tmp_path, file)
    whole = np.array(import_dataset(path, tmp_path / "whole.nacre").samples)
    assert whole.nbytes > 3_000_000
    # A block of 3 views, so that the last one of a light is a short one; and a block of less than
    # an image.
    for texels in (3 * 32 * 40, 500):
        monkeypatch.setattr(contents, "BLOCK_BYTES", texels * 3 * 4)
        tracemalloc.start()
        parts = import_dataset(path, tmp_path / "parts.nacre").samples
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        np.testing.assert_allclose(parts, whole, rtol=2e-3, atol=1e-4)
        assert peak < 600_000


@pytest.mark.parametrize(
    ("file", "says"),
    [
        (b"", "starts with ''"),
        (b"PK\3\4 not a btf at all", "is not a .btf file of Bonn's"),
        (b"!DFMF09FCR" + bytes(400), "is not a .btf file of Bonn's"),
        (BtfFile(version=0), "header version 0"),
        (BtfFile(version=5), "header version 5"),
        (BtfFile(colour_model=7), "unknown colour model 7; known are: 0 RGB, 1 YUV"),
        (BtfFile(colour_model=-1), "unknown colour model -1"),
        (BtfFile(colour_model=3, mean=(0, np.nan, 0)), "the PCA's mean and matrix are not finite"),
        (BtfFile(version=4, channel_names=()), "0 colour channels"),
        (BtfFile(version=4, channel_names=(b"",) * 1025), "1025 colour channels"),
        (
            BtfFile(version=4, channel_names=(b"400nm",) * 31, colour_model=11),
            r"31 colour channels, but the colour model 11 \(log Y, U/Y, V/Y\) is one of three",
        ),
        (
            BtfFile(version=4, channel_names=(b"a",) * 5, scalars=(4,) * 5, components=(1,) * 5),
            r"channels a, a, a, a, \.\.\. \(5\); expected red, green and blue, or wavelengths",
        ),
        (BtfFile(version=4, channel_names=(b"X", b"Y", b"Z")), "channels X, Y, Z"),
        (BtfFile(other_light={1: ((0.0, 0.0),)}), "other light directions for view 1"),
        (BtfFile(view=()), "has no views"),
        (BtfFile(light=()), "has no lights"),
        (BtfFile(light=((0.0, 0.0), (2.0, 0.0))), "light 1 has theta 114.592"),
        (BtfFile(view=((0.0, np.nan),)), "view 0 has .* phi nan"),
        (
            BtfFile(view=((0.0, 0.25),))
            .to_bytes()
            .replace(struct.pack("<2fI", 0, 0.25, 3), struct.pack("<f2I", 0, 0x7F800001, 3)),
            "view 0 has .* phi nan",  # a signalling one
        ),
        (BtfFile(width=0), "0 x 4 texels"),
        (BtfFile(components=(1, 0, 1)), "channel 2 has no components"),
        (BtfFile(trailing=b"\0"), "1 bytes follow its end"),
    ],
)
def test_a_file_that_cannot_be_read_is_one_clear_error(tmp_path, file, says):
    assert_refused(tmp_path, file, says)


def patched(offset, layout, *values):
    """The usual file with other numbers at an offset behind the header."""
    data = bytearray(BtfFile().to_bytes())
    struct.pack_into("<" + layout, data, offset, *values)
    return bytes(data)


META = 10 + 4 + 4 + 240 + 16 + 4
SIZE = META + 4 + 2 * (12 + 3 * 8)
CHANNEL = SIZE + 8 + 4 + 8 + 48


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (patched(10, "I", 2**32 - 1), "the header needs 4294967291 bytes"),
        (patched(10, "I", 0), "damaged header"),
        (patched(10, "I", 100), "damaged header"),
        (patched(META, "I", 2**32 - 1), "4294967295 views needs 51539607540 bytes"),
        (patched(META + 12, "I", 2**31), "2147483648 light directions of view 0"),
        (patched(SIZE, "2I", 2**32 - 1, 2**32 - 1), "images need 6 x 18446744065119617025"),
        (patched(SIZE, "2I", 2, 10), "channel 1's SxV|channel 2|follow its end|is a matrix of"),
        (patched(SIZE + 8, "I", 2**32 - 1), "4294967295 rotations needs 154618822620 bytes"),
        (patched(CHANNEL, "B", 3), "scalars of 3 bytes"),
        (patched(CHANNEL + 1, "I", 2**32 - 1), "channel 1's singular values needs 17179869180"),
        (patched(CHANNEL + 5, "I", 2**32 - 1), "is a matrix of 4294967295 x 20"),
    ],
)
def test_absurd_sizes_are_refused_before_memory_is_taken(tmp_path, data, says):
    if "channel 2" in says:
        # As many texels in another shape: nothing is wrong with that.
        imported(tmp_path, data)
        return
    tracemalloc.start()
    assert_refused(tmp_path, data, says)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 500_000


SIGNALLING = np.array(0x7F800001, "<u4").view("<f4")


@pytest.mark.parametrize(
    ("value", "scalar"), [(np.nan, 4), (-np.inf, 2), (1e300, 8), (SIGNALLING, 4)]
)
def test_a_factor_that_is_not_finite_is_named(tmp_path, value, scalar):
    file = BtfFile(scalars=(4, scalar, 4))
    data = bytearray(file.to_bytes())
    factors = file.factors()
    start = bytes(data).index(factors[1][1].tobytes())
    at = start + (7 * 2 + 1) * scalar
    data[at : at + scalar] = np.array(value, factors[1][1].dtype).tobytes()
    assert_refused(tmp_path, bytes(data), "channel 2's SxV has .* not a finite number in row 7")


def test_an_exponential_that_overflows_is_named(tmp_path):
    path = save(tmp_path, BtfFile(colour_model=12, scale=900.0))
    with pytest.raises(NacreError, match="at light .* is not a finite number"):
        import_dataset(path, tmp_path / "cloth.nacre")
    assert os.listdir(tmp_path) == ["cloth.btf"]


def test_every_truncation_is_one_clear_error(tmp_path):
    for version in (1, 4):
        data = BtfFile(version=version, scalars=(2, 2, 2)).to_bytes()
        for cut in range(0, len(data), 7):
            assert_refused(tmp_path, data[:cut], "cut short|damaged|not a .btf file")
        assert_refused(tmp_path, data[:-1], "channel 3's SxV needs 40 bytes, 39 are left")
