"""The other layouts of Bonn's files: FMF, PVF and BDI."""

import itertools
import os
import tracemalloc

import numpy as np
import pytest
from bonn_files import BdiFile, FmfFile, PvfFile
from btf_writer import BtfFile

from addon.datasets.bonn import bdi, contents
from addon.datasets.colour import spectrum_to_rec709
from addon.datasets.dataset import DatasetWriter
from addon.datasets.importing import describe_source, import_dataset
from addon.errors import NacreError

MASK = np.array([[1, 0, 1, 1, 0], [0, 0, 0, 0, 0], [1, 1, 1, 1, 1], [1, 1, 0, 1, 0]], bool)
BGR = (b"Blue", b"Green", b"Red")


def save(folder, file):
    path = folder / "cloth.btf"
    path.write_bytes(file if isinstance(file, bytes) else file.to_bytes())
    return path


def imported(folder, file, **options):
    return import_dataset(save(folder, file), folder / "cloth.nacre", **options)


def assert_read(folder, file, rtol=2e-5, **options):
    dataset = imported(folder, file, **options)
    np.testing.assert_allclose(dataset.samples, file.expected(), rtol=rtol, atol=2e-6)
    return dataset


def assert_refused(folder, file, says):
    path = save(folder, file)
    with pytest.raises(NacreError, match=says) as caught:
        import_dataset(path, folder / "cloth.nacre")
    assert "\n" not in str(caught.value)
    assert "cloth.btf" in str(caught.value)
    assert os.listdir(folder) == ["cloth.btf"]


@pytest.mark.parametrize(
    ("signature", "fmf_version", "transposed"),
    [
        *itertools.product([b"!FMF12FCER"], (0, 1, 2), (False, True)),
        *itertools.product([b"!FMF06FCR", b"!FMF06FC"], (0,), (False, True)),
    ],
)
def test_fmf(tmp_path, signature, fmf_version, transposed):
    file = FmfFile(signature=signature, fmf_version=fmf_version, transposed=transposed)
    assert_read(tmp_path, file)


@pytest.mark.parametrize("transposed", [False, True])
def test_fmf_with_all_that_it_may_have(tmp_path, transposed):
    file = FmfFile(
        version=4, transposed=transposed, logarithms=3, height_map=(6, 2), scalar=8, stored=5,
        most=2, rotations=np.ones((2, 3, 3)), scale=0.5,
    )  # fmt: skip
    dataset = assert_read(tmp_path, file)
    assert dataset.source["conversions"] == [
        "logarithms decoded to linear values",
        "height map of 6 x 2 texels left out",
        "rotations of local frames left out",
    ]
    summary = describe_source(tmp_path / "cloth.btf")
    assert (summary["layout"], summary["components"]) == ("FMF", [2])


def test_fmf_of_half_floats_becomes_half_floats(tmp_path):
    file = FmfFile(scalar=2)
    assert assert_read(tmp_path, file, rtol=2e-3).samples.dtype == np.float16


@pytest.mark.parametrize(("oldest", "transposed"), list(itertools.product((False, True), repeat=2)))
@pytest.mark.parametrize("signature", [b"!PVF06FCR", b"!PVF06FC"])
def test_pvf(tmp_path, signature, oldest, transposed):
    file = PvfFile(signature=signature, oldest=oldest, transposed=transposed)
    dataset = assert_read(tmp_path, file)
    if oldest:
        assert "no scale in the file" in dataset.source["conversions"][-1]
    summary = describe_source(tmp_path / "cloth.btf")
    assert (summary["layout"], summary["components"]) == ("PVF", [2, 3])


@pytest.mark.parametrize("lines", [1, 3, 9])
@pytest.mark.parametrize("compression", [0, 1, 2])
@pytest.mark.parametrize("mask", [None, MASK, np.zeros_like(MASK)])
def test_bdi(tmp_path, lines, compression, mask):
    file = BdiFile(lines=lines, compression=compression, mask=mask)
    dataset = imported(tmp_path, file)
    np.testing.assert_array_equal(dataset.samples, file.expected())
    assert dataset.samples.dtype == np.float16
    recorded = "".join(dataset.source["conversions"])
    if mask is None:
        assert not recorded
    else:
        what = "not stored, taken as 0" if compression == 2 else "masked, taken as stored"
        assert recorded == f"{mask.size - mask.sum()} of 20 texels {what}"


@pytest.mark.parametrize("compression", [0, 1, 2])
def test_bdi_in_small_pieces(tmp_path, compression, monkeypatch):
    """Pieces that end within and at the ends of chunks, lines and what the mask leaves."""
    file = BdiFile(compression=compression, mask=MASK, rotations=np.ones((1, 3, 3)), cosine_flag=0)
    texel = len(file.light) * len(file.view) * 3 * 2
    for texels in (1, 2, 5, 7, 15):
        monkeypatch.setattr(bdi, "BLOCK_BYTES", -(-texels * texel * 2 // 3))
        dataset = imported(tmp_path, file)
        np.testing.assert_allclose(
            dataset.samples, file.expected(times_cosine=True), rtol=1e-3, atol=1e-7
        )


@pytest.mark.parametrize("make", [FmfFile, PvfFile, BdiFile])
def test_memory_is_that_of_factors_and_a_block(tmp_path, make, monkeypatch):
    directions = tuple((0.07 * i, 0.3 * i) for i in range(20))
    path = save(tmp_path, make(light=directions, view=directions, width=32, height=40))
    for module in (bdi, contents):
        monkeypatch.setattr(module, "BLOCK_BYTES", 50_000)
    tracemalloc.start()
    dataset = import_dataset(path, tmp_path / "a.nacre")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert dataset.samples.nbytes > 3_000_000
    assert peak < 600_000


@pytest.mark.parametrize("make", [FmfFile, PvfFile, BdiFile])
def test_what_all_layouts_share(tmp_path, make):
    """Order of the channels, cosine, scale, and blocks of less than an image."""
    file = make(version=4, channel_names=BGR, cosine_flag=0, pixels_per_mm=0.0)
    dataset = imported(tmp_path, file, patch_width=0.02)
    np.testing.assert_allclose(
        dataset.samples, file.expected(times_cosine=True)[..., ::-1], rtol=1e-3, atol=2e-6
    )
    assert dataset.patch_size == pytest.approx((0.02, 0.016))
    assert "cosine flag 0" in dataset.source["conversions"][0]


@pytest.mark.parametrize("make", [FmfFile, PvfFile])
@pytest.mark.parametrize("transposed", [False, True])
def test_blocks_may_be_parts_of_images(tmp_path, make, transposed, monkeypatch):
    file = make(transposed=transposed)
    for texels in (1, 7, 20, 33):
        monkeypatch.setattr(contents, "BLOCK_BYTES", texels * 3 * 4)
        assert_read(tmp_path, file)


@pytest.mark.parametrize(
    ("file", "says"),
    [
        (FmfFile(fmf_version=3), "FMF header version 3; 0 to 2 are"),
        (FmfFile(trailing=b"12"), "2 bytes follow its end"),
        (FmfFile(height_map=(2, 2)).to_bytes()[:-1], "SxV needs 320 bytes, 319 are left"),
        (PvfFile(slots=1), "the factors of 1 views, but 2 views"),
        (PvfFile(trailing=b"1"), "1 bytes follow its end"),
        (BdiFile(compression=3), "unknown BDI compression 3; known are: 0 full, 1 full, bzip2, 2"),
        (BdiFile(trailing=b"1"), "1 bytes follow"),
        (BtfFile(signature=b"!BDIF06R1!"), "is not a .btf file"),
    ],
)
def test_a_file_that_cannot_be_read_is_one_clear_error(tmp_path, file, says):
    assert_refused(tmp_path, file, says)


@pytest.mark.parametrize("transposed", [False, True])
@pytest.mark.parametrize(
    ("make", "says"),
    [(FmfFile, "its matrix is one of"), (PvfFile, "view 0 has"), (FmfFile, "no components")],
)
def test_matrices_that_do_not_fit_are_refused(tmp_path, make, says, transposed):
    file = make(transposed=transposed)
    data = bytearray(file.to_bytes())
    if says == "no components":  # three counts lie before the singular values, which are ones
        at = bytes(data).index(np.ones(4, "<f4").tobytes()) - 12
        data[at : at + 4] = bytes(4)
    else:
        position = bytes(data).index(file.size())
        data[position : position + 4] = (6).to_bytes(4, "little")
    assert_refused(tmp_path, bytes(data), says)


@pytest.mark.parametrize("make", [FmfFile, PvfFile, BdiFile])
def test_every_truncation_is_one_clear_error(tmp_path, make):
    data = make().to_bytes()
    for cut in range(0, len(data), 13):
        assert_refused(tmp_path, data[:cut], "cut short|damaged|not a .btf file")


@pytest.mark.parametrize(
    ("number", "says"),
    [(0, "the mask|chunk 0|are left"), (2**32 - 1, "the mask|chunk|are left"), (7, "chunk|left")],
)
def test_sizes_that_do_not_fit_are_refused_before_memory_is_taken(tmp_path, number, says):
    file = BdiFile()
    data = bytearray(file.to_bytes())
    at = bytes(data).index(file.size()) + 4
    data[at : at + 4] = number.to_bytes(4, "little")
    tracemalloc.start()
    assert_refused(tmp_path, bytes(data), says if number else "images are 5 x 0 texels")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 500_000


def test_chunks_without_lines_are_refused(tmp_path):
    file = BdiFile()
    data = file.to_bytes().replace(file.size() + bytes([3]), file.size() + bytes([0]))
    assert_refused(tmp_path, data, "its chunks have no scan lines")


def test_a_chunk_of_another_size_is_refused(tmp_path):
    file = BdiFile(lines=2)
    data = file.to_bytes()
    at = data.index(file.chunks()[0]) - 4
    data = data[:at] + (7).to_bytes(4, "little") + data[at + 4 :]
    assert_refused(tmp_path, data, "chunk 0 has 7 bytes, but its texels need 360")


@pytest.mark.parametrize("damage", ["cut", "longer", "shorter", "more", "no bzip2"])
def test_a_chunk_that_does_not_unpack_is_refused(tmp_path, damage, monkeypatch):
    import bz2

    file = BdiFile(compression=1, lines=2)
    good = file.chunks()
    raw = bz2.decompress(good[1])
    bad = {
        "cut": good[1][:-3],
        "longer": bz2.compress(raw + b"1"),
        "shorter": bz2.compress(raw[:-1]),
        "more": good[1] + b"123",
        "no bzip2": b"hello" + good[1],
    }[damage]
    for number in (0, 1):
        chunks = [*good[:number], bad, *good[number + 1 :]]
        monkeypatch.setattr(file, "chunks", lambda chunks=chunks: chunks)
        assert_refused(tmp_path, file, f"chunk {number} is no bzip2 stream of 360 bytes")


def test_a_bdi_value_that_is_not_finite_is_named(tmp_path, monkeypatch):
    file = BdiFile()
    samples = file.samples()
    samples[3, 2, 1, 0, 2] = np.nan
    monkeypatch.setattr(file, "samples", lambda: samples)
    assert_refused_at(tmp_path, file, "value at light 0, view 1, y 3, x 2, channel 2 is not a fin")


def assert_refused_at(folder, file, says):
    path = save(folder, file)
    with pytest.raises(NacreError, match=says):
        import_dataset(path, folder / "cloth.nacre")
    assert os.listdir(folder) == ["cloth.btf"]


def test_texels_may_be_written_before_images(tmp_path):
    rng = np.random.default_rng(0)
    samples = rng.random((2, 3, 4, 5, 3)).astype(np.float32)
    directions = [[0.0, 0.0, 1.0]]
    description = {
        "nacre": 1, "kind": "btf", "axes": ["light", "view", "y", "x", "channel"],
        "light": directions * 2, "view": directions * 3, "channels": ["R", "G", "B"],
        "patch_size": [1, 1], "periodic": True, "noise_floor_db": None, "source": {},
    }  # fmt: skip
    texels = samples.reshape(2, 3, 20, 3)
    with DatasetWriter(tmp_path / "a.nacre", description, samples.shape, np.float32) as writer:
        for first, last in ((0, 1), (1, 8), (8, 20)):
            writer.write_texels(texels[:, :, first:last])
            assert writer.fraction == pytest.approx(last / 20)
    written = np.load(tmp_path / "a.nacre" / "samples.npy")
    np.testing.assert_array_equal(written, samples)


NANOMETRES = (450, 400, 550, 500, 650, 600, 700)
SPECTRUM = {
    "version": 4,
    "channel_names": (b"450nm", *(str(nm).encode() for nm in NANOMETRES[1:])),
}


def to_rgb(spectra):
    """Linear RGB of spectra (..., channel), by the table of the colours of all wavelengths."""
    order = np.argsort(NANOMETRES)
    return spectra[..., order] @ spectrum_to_rec709(sorted(NANOMETRES)).T


@pytest.mark.parametrize(
    "file",
    [
        *(
            BtfFile(colour_model=model, scalars=(4,) * 7, components=(2,) * 7, **SPECTRUM)
            for model in (0, 5, 6, 12)
        ),
        FmfFile(**SPECTRUM),
        PvfFile(**SPECTRUM),
        BdiFile(compression=0, cosine_flag=0, **SPECTRUM),
    ],
    ids=lambda file: f"{type(file).__name__}{file.colour_model}",
)
def test_wavelengths_become_colours(tmp_path, file):
    dataset = imported(tmp_path, file)
    expected = to_rgb(file.expected(times_cosine=file.cosine_flag == 0))
    rtol, atol = (1e-3, 1e-3) if isinstance(file, BdiFile) else (1e-4, 1e-5)
    np.testing.assert_allclose(dataset.samples, expected, rtol=rtol, atol=atol)
    recorded = dataset.source["conversions"]
    assert "7 wavelengths from 400 to 700 nm to linear Rec.709 under D65" in recorded
    assert dataset.channels == ("R", "G", "B")


def test_a_spectrum_of_one_is_white(tmp_path):
    file = BdiFile(**SPECTRUM)
    file.samples = lambda: np.ones((4, 5, 2, 3, 7), np.float16)
    np.testing.assert_allclose(imported(tmp_path, file).samples, 1.0, atol=1e-3)


def test_names_of_channels_are_shown_on_one_line(tmp_path):
    file = FmfFile(version=4, channel_names=(b"a\nb", b"x" * 1000, b"99999999 nm"))
    assert_refused(tmp_path, file, r"has the channels 'a\\nb', x{40}, 99999999 nm; expected")


def test_the_memory_is_told_beforehand(tmp_path):
    directions = tuple((0.07 * i, 0.3 * i) for i in range(20))
    for make, factors in (
        (FmfFile, 4 * 4 * (400 * 3 + 1280)),
        (PvfFile, 21 * 4 * (20 * 3 + 1280)),
        (BdiFile, 400 * 1280 * 6),
    ):
        path = save(tmp_path, make(light=directions, view=directions, width=32, height=40))
        blocks = 4 * 400 * 1280 * 12
        assert describe_source(path)["memory_bytes"] == factors + blocks


def test_a_wavelength_may_not_come_twice(tmp_path):
    names = (b"400", b"500", b"400 nm")
    assert_refused(tmp_path, FmfFile(version=4, channel_names=names), "several channels of one")
