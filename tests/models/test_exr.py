"""Model files: what is in them, and what happens when they are damaged or cannot be written."""

import errno
import json
import os
import random
import resource
import shutil

import numpy as np
import OpenEXR
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_btf import make_model

from addon.errors import NacreError
from addon.models import exr_arrays
from addon.models.exr import load_model, read_picture, save_model
from addon.models.exr_arrays import is_model, read_arrays, write_arrays

MKCTA = {
    "clusters": {"light": 2, "view": 3},
    "mixtures": {"light": 2, "view": 2},
    "shared": ("y", "x"),
}


@pytest.fixture
def model():
    return make_model(**MKCTA)


@pytest.fixture
def path(tmp_path, model):
    save_model(model, tmp_path / "m.exr")
    return tmp_path / "m.exr"


def one_line(error, *words):
    text = str(error.value)
    assert "\n" not in text
    for word in words:
        assert word in text
    return text


def arrays_of(model):
    return {
        "core": model.core,
        **{f"basis_{mode}": basis for mode, basis in model.bases.items()},
        **{f"members_{mode}": members for mode, members in model.members.items()},
    }


def test_a_model_comes_back(model, path):
    loaded = load_model(path)
    for name, array in arrays_of(model).items():
        other = arrays_of(loaded)[name]
        assert other.shape == array.shape
        assert other.dtype == array.dtype
        if array.dtype == np.uint32:
            np.testing.assert_array_equal(other, array)
        else:  # a half has 11 bits, and less below 2^-14 of the peak
            peak = np.abs(array).max()
            bound = np.maximum(np.abs(array) * 2.0**-11, peak * 2.0**-25) * (1 + 1e-6)
            assert (np.abs(other - array) <= bound).all()
    assert loaded.clusters == model.clusters
    assert loaded.dataset == model.dataset
    assert loaded.fit == model.fit
    np.testing.assert_allclose(loaded.decode(), model.decode(), rtol=0.02, atol=0.2)


def test_the_same_model_gives_the_same_bytes(model, path, tmp_path):
    save_model(model, tmp_path / "again.exr")
    assert (tmp_path / "again.exr").read_bytes() == path.read_bytes()


def test_a_saved_model_is_saved_without_loss(path, tmp_path):
    save_model(load_model(path), tmp_path / "again.exr")
    assert (tmp_path / "again.exr").read_bytes() == path.read_bytes()


def test_any_viewer_sees_one_grey_picture_for_each_array(model, path):
    parts = OpenEXR.File(str(path), separate_channels=True).parts
    assert [part.name() for part in parts] == list(arrays_of(model))
    windows = [np.array(part.header["displayWindow"]).tolist() for part in parts]
    assert all(window == windows[0] for window in windows)
    for part, array in zip(parts, arrays_of(model).values(), strict=True):
        (channel,) = part.channels.values()
        assert channel.name == "Y"
        assert channel.pixels.shape == (array.size // array.shape[-1], array.shape[-1])
        assert part.type() == OpenEXR.scanlineimage
        assert part.compression() == OpenEXR.ZIP_COMPRESSION
        if array.dtype == np.uint32:
            assert channel.type() == OpenEXR.UINT
            np.testing.assert_array_equal(channel.pixels.ravel(), array.ravel())
        else:
            assert channel.type() == OpenEXR.HALF
            assert np.abs(channel.pixels).max() == 1.0
    width = max(array.shape[-1] for array in arrays_of(model).values())
    height = max(array.size // array.shape[-1] for array in arrays_of(model).values())
    assert windows[0] == [[0, 0], [width - 1, height - 1]]


def test_the_description_is_json_in_one_attribute(model, path):
    first, *others = OpenEXR.File(str(path)).parts
    assert not any("nacre" in part.header for part in others)
    description = json.loads(first.header["nacre"])
    assert description["nacre"] == 1
    assert description["kind"] == "btf"
    assert description["model"] == "clustered-tucker"
    assert description["modes"] == ["light", "view", "y", "x"]
    assert description["clusters"] == {"light": 2, "view": 3}
    assert description["dataset"] == model.dataset
    assert description["fit"] == model.fit
    arrays = description["arrays"]
    assert {name: entry["shape"] for name, entry in arrays.items()} == {
        name: list(array.shape) for name, array in arrays_of(model).items()
    }
    assert arrays["core"]["axes"] == ["cluster", "light", "view", "y", "x"]
    assert arrays["basis_y"]["axes"] == ["owner", "y", "mixture", "rank"]
    assert arrays["members_view"]["axes"] == ["view", "mixture"]
    assert arrays["core"]["scale"] == np.abs(model.core).max()
    assert arrays["members_view"]["scale"] == 1.0


def test_values_far_from_1_keep_their_precision(tmp_path):
    """Half floats end at 65504 and at 6e-8."""
    values = np.array([[1.0, 0.25, -0.5]], np.float32)
    arrays = {"large": values * 1e20, "small": values * 1e-20, "zero": values * 0}
    write_arrays(tmp_path / "a.exr", arrays, dict.fromkeys(arrays, []), {})
    loaded, _ = read_arrays(tmp_path / "a.exr")
    for name, array in arrays.items():
        np.testing.assert_allclose(loaded[name], array, rtol=1e-7)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    st.lists(st.integers(1, 5), min_size=1, max_size=5),
    st.floats(-30, 30),
    st.booleans(),
    st.integers(0, 99),
)
def test_arrays_of_any_shape_and_size(tmp_path_factory, shape, exponent, index, seed):
    path = tmp_path_factory.mktemp("arrays", numbered=True) / "a.exr"
    rng = np.random.default_rng(seed)
    if index:
        array = rng.integers(0, 2**32, shape, dtype=np.uint32)
    else:
        array = (rng.normal(size=shape) * 10.0**exponent).astype(np.float32)
    write_arrays(path, {"a": array}, {"a": ["n"] * len(shape)}, {})
    loaded, description = read_arrays(path)
    assert loaded["a"].shape == tuple(shape)
    assert description["arrays"]["a"]["axes"] == ["n"] * len(shape)
    np.testing.assert_allclose(loaded["a"], array, rtol=0 if index else 2.0**-10.9)


def test_a_model_cut_short_is_refused(path, capfd):
    data = path.read_bytes()
    lengths = [*range(0, 64), *range(64, len(data), 211), len(data) - 4, len(data) - 1]
    for length in lengths:
        path.write_bytes(data[:length])
        with pytest.raises(NacreError) as error:
            load_model(path)
        one_line(error, "m.exr")
    path.write_bytes(data + b"\0")
    with pytest.raises(NacreError, match="damaged"):
        load_model(path)
    assert capfd.readouterr() == ("", "")


def test_a_changed_byte_is_found(model, path, capfd):
    data = bytearray(path.read_bytes())
    rng = random.Random(5)
    for _ in range(300):
        position, change = rng.randrange(len(data)), rng.randrange(1, 256)
        data[position] ^= change
        path.write_bytes(data)
        data[position] ^= change
        with pytest.raises(NacreError) as error:
            load_model(path)
        one_line(error, "m.exr")
    assert capfd.readouterr() == ("", "")
    path.write_bytes(data)
    assert load_model(path).fit == model.fit


def test_what_is_no_model(tmp_path):
    with pytest.raises(NacreError) as error:
        load_model(tmp_path / "absent.exr")
    one_line(error, "no such file")
    with pytest.raises(NacreError) as error:
        load_model(tmp_path)
    one_line(error, "cannot be read")
    (tmp_path / "text.exr").write_text("theta,phi")
    with pytest.raises(NacreError) as error:
        load_model(tmp_path / "text.exr")
    one_line(error, "not an OpenEXR file")
    write_picture(tmp_path / "p.exr")
    with pytest.raises(NacreError) as error:
        load_model(tmp_path / "p.exr")
    one_line(error, "picture")


def test_a_newer_file_says_so(path, monkeypatch, model):
    monkeypatch.setattr(exr_arrays, "VERSION", 2)
    save_model(model, path)
    monkeypatch.undo()
    with pytest.raises(NacreError) as error:
        load_model(path)
    one_line(error, "version 2", "update")


def test_another_kind_of_model_says_so(tmp_path):
    write_arrays(tmp_path / "s.exr", {"a": np.ones((2, 2))}, {"a": []}, {"model": "sparse"})
    with pytest.raises(NacreError) as error:
        load_model(tmp_path / "s.exr")
    one_line(error, "'sparse'")


@pytest.mark.parametrize("name", ["core", "basis_view", "members_view"])
def test_a_missing_part_is_named(name, model, tmp_path):
    arrays = arrays_of(model)
    del arrays[name]
    description = {
        "model": "clustered-tucker",
        "clusters": model.clusters,
        "dataset": model.dataset,
        "fit": {},
    }
    write_arrays(tmp_path / "m.exr", arrays, dict.fromkeys(arrays, []), description)
    with pytest.raises(NacreError) as error:
        load_model(tmp_path / "m.exr")
    one_line(error, name)


def test_a_name_that_cannot_be_written_is_refused(model, tmp_path):
    for name, words in (
        ("m.png", ".exr"),
        ("absent/m.exr", "no folder"),
        (f"{'m' * 300}.exr", "cannot write"),
    ):
        with pytest.raises(NacreError) as error:
            save_model(model, tmp_path / name)
        one_line(error, words)
    (tmp_path / "folder.exr").mkdir()
    with pytest.raises(NacreError) as error:
        save_model(model, tmp_path / "folder.exr")
    one_line(error, "folder")
    assert os.listdir(tmp_path) == ["folder.exr"]


def test_an_older_model_is_replaced(path):
    other = make_model(seed=1)
    save_model(other, path)
    assert load_model(path).core.shape == other.core.shape
    assert os.listdir(path.parent) == [path.name]


@pytest.fixture
def file_size_limit():
    """A function that limits the size of files that are written, as a full disk does."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def limit(size):
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))

    yield limit
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize("older", [True, False])
def test_a_full_disk_leaves_what_was_there(older, model, tmp_path, file_size_limit, capfd):
    path = tmp_path / "m.exr"
    save_model(model, path)
    size = path.stat().st_size
    before = path.read_bytes()
    # The library notices a disk that is full at once, but not one that fills up at the very end.
    for limit in (0, 100, 1000, size // 2, size - 500, size - 8, size - 1):
        if not older:
            path.unlink(missing_ok=True)
        file_size_limit(limit)
        with pytest.raises(NacreError) as error:
            save_model(model, path)
        file_size_limit(resource.RLIM_INFINITY)
        one_line(error, "no room", "m.exr", "free space")
        assert os.listdir(tmp_path) == (["m.exr"] if older else [])
    if older:
        assert path.read_bytes() == before
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("number", [errno.EACCES, errno.EIO])
def test_a_failed_rename_leaves_what_was_there(number, model, path, monkeypatch):
    before = path.read_bytes()

    def fail(*_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(exr_arrays.os, "replace", fail)
    with pytest.raises(NacreError) as error:
        save_model(make_model(seed=1), path)
    one_line(error, os.strerror(number))
    assert path.read_bytes() == before
    assert os.listdir(path.parent) == [path.name]


def write_picture(path, names="RGB", shape=(9, 7)):
    pixels = np.random.default_rng(0).random((*shape, len(names))).astype(np.float32)
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File(header, {names: pixels}).write(str(path))
    return pixels


@pytest.mark.parametrize("names", ["RGB", "RGBA"])
def test_pictures_are_read_bottom_row_first(names, tmp_path):
    pixels = write_picture(tmp_path / "p.exr", names)
    assert not is_model(tmp_path / "p.exr")
    np.testing.assert_array_equal(read_picture(tmp_path / "p.exr"), pixels[::-1, :, :3])


def test_a_grey_picture_is_refused(tmp_path):
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File(header, {"Y": np.ones((4, 4), np.float32)}).write(str(tmp_path / "p.exr"))
    with pytest.raises(NacreError, match="not a colour picture"):
        read_picture(tmp_path / "p.exr")


def test_a_picture_cut_short_is_refused_in_one_line(tmp_path, capfd):
    path = tmp_path / "p.exr"
    write_picture(path, shape=(64, 48))
    data = path.read_bytes()
    for length in [*range(0, 480, 32), *range(480, len(data), 4001), len(data) - 1]:
        path.write_bytes(data[:length])
        with pytest.raises(NacreError) as error:
            read_picture(path)
        one_line(error, "p.exr")
    assert capfd.readouterr() == ("", "")
    os.write(2, b"still there")
    assert capfd.readouterr().err == "still there"


def test_standard_error_may_be_missing(tmp_path):
    """A program without a console has none."""
    pixels = write_picture(tmp_path / "p.exr")
    kept = os.dup(2)
    os.close(2)
    try:
        np.testing.assert_array_equal(read_picture(tmp_path / "p.exr"), pixels[::-1])
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def test_a_model_survives_a_copy(path, tmp_path):
    shutil.copy(path, tmp_path / "copy.exr")
    np.testing.assert_array_equal(load_model(tmp_path / "copy.exr").core, load_model(path).core)
