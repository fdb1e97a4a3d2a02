import errno
import json
import os
import shutil
from collections import namedtuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.datasets.dataset import DatasetWriter, HalfOverflowError, open_dataset
from addon.errors import NacreError

SHAPE = (2, 3, 4, 5, 3)
UP = [0.0, 0.0, 1.0]


def description(**changes):
    return {
        "nacre": 1,
        "kind": "btf",
        "axes": ["light", "view", "y", "x", "channel"],
        "light": [UP, [0.6, 0.0, 0.8]],
        "view": [UP, [0.0, 0.6, 0.8], [0.0, -0.6, 0.8]],
        "channels": ["R", "G", "B"],
        "patch_size": [0.01, 0.008],
        "periodic": True,
        "noise_floor_db": None,
        "source": {"format": "btf", "file": "x.btf", "conversions": []},
        **changes,
    }


def samples(dtype=np.float32):
    return np.arange(np.prod(SHAPE), dtype=dtype).reshape(SHAPE)


def write(path, dtype=np.float32, **changes):
    with DatasetWriter(path, description(**changes), SHAPE, dtype) as writer:
        for light in samples():
            writer.write(light)
    return path


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_what_is_written_is_opened(tmp_path, dtype):
    dataset = open_dataset(write(tmp_path / "a.nacre", dtype))
    assert dataset.shape == SHAPE
    assert dataset.samples.dtype == dtype
    assert dataset.raw_bytes == 4 * np.prod(SHAPE)
    np.testing.assert_array_equal(dataset.samples, samples())
    np.testing.assert_array_equal(dataset.light, [UP, [0.6, 0, 0.8]])
    assert dataset.axes == ("light", "view", "y", "x", "channel")
    assert dataset.channels == ("R", "G", "B")
    assert dataset.patch_size == (0.01, 0.008)
    assert dataset.periodic is True
    assert dataset.noise_floor_db is None
    assert dataset.source["format"] == "btf"


def test_samples_are_mapped_read_only(tmp_path):
    dataset = open_dataset(write(tmp_path / "a.nacre"))
    assert isinstance(dataset.samples, np.memmap)
    assert not dataset.samples.flags.writeable
    assert not dataset.light.flags.writeable
    assert dataset.samples.flags.c_contiguous


def test_the_files_are_plain_npy_and_json(tmp_path):
    path = write(tmp_path / "a.nacre")
    np.testing.assert_array_equal(np.load(path / "samples.npy"), samples())
    assert json.loads((path / "dataset.json").read_text()) == description()
    assert sorted(os.listdir(path)) == ["dataset.json", "samples.npy"]


def test_an_older_dataset_is_replaced(tmp_path):
    path = write(tmp_path / "a.nacre", periodic=True)
    write(path, np.float16, periodic=False)
    dataset = open_dataset(path)
    assert dataset.periodic is False
    assert dataset.samples.dtype == np.float16
    assert os.listdir(tmp_path) == ["a.nacre"]


def test_an_error_leaves_the_older_dataset_and_nothing_else(tmp_path):
    path = write(tmp_path / "a.nacre")
    with (
        pytest.raises(RuntimeError, match="stop"),
        DatasetWriter(path, description(), SHAPE, np.float16) as writer,
    ):
        writer.write(samples()[0])
        raise RuntimeError("stop")
    assert open_dataset(path).samples.dtype == np.float32
    assert os.listdir(tmp_path) == ["a.nacre"]


def test_too_few_and_too_many_samples_are_refused(tmp_path):
    with pytest.raises(ValueError, match="60 of 120|of 360 samples"):  # noqa: SIM117
        with DatasetWriter(tmp_path / "a.nacre", description(), SHAPE, np.float32) as writer:
            writer.write(samples()[0])
    with pytest.raises(ValueError, match="more samples"):  # noqa: SIM117
        with DatasetWriter(tmp_path / "a.nacre", description(), SHAPE, np.float32) as writer:
            writer.write(samples())
            writer.write(np.zeros(1))
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    ("value", "dtype", "error", "says"),
    [
        (np.nan, np.float32, NacreError, "at light 1, view 2, y 0, x 4, channel 1 is not a finite"),
        (np.inf, np.float16, NacreError, "is not a finite number"),
        (1e5, np.float16, HalfOverflowError, "100000 at light 1, view 2, y 0, x 4, channel 1"),
        (-1e5, np.float16, HalfOverflowError, "too large for half floats"),
    ],
)
def test_a_value_that_cannot_be_stored_is_named_with_its_place(tmp_path, value, dtype, error, says):
    broken = samples()
    broken[1, 2, 0, 4, 1] = value
    with pytest.raises(error, match=says) as caught:  # noqa: SIM117
        with DatasetWriter(tmp_path / "a.nacre", description(), SHAPE, dtype) as writer:
            writer.write(broken[0])
            writer.write(broken[1])
    assert type(caught.value) is error
    assert os.listdir(tmp_path) == []


def test_only_a_dataset_is_overwritten(tmp_path):
    folder = tmp_path / "pictures"
    folder.mkdir()
    (folder / "holiday.jpg").touch()
    (tmp_path / "file").touch()
    for path in (folder, tmp_path / "file"):
        with pytest.raises(NacreError, match="exists and is not a Nacre dataset"):
            write(path)
    with pytest.raises(NacreError, match="there is no folder"):
        write(tmp_path / "absent" / "a.nacre")
    with pytest.raises(NacreError, match="no name for a dataset"):
        write("")
    assert sorted(os.listdir(tmp_path)) == ["file", "pictures"]
    assert os.listdir(folder) == ["holiday.jpg"]


def test_a_full_disk_is_said_before_anything_is_written(tmp_path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(100, 0, 1000))
    with pytest.raises(NacreError, match="no room to write .*a.nacre"):
        write(tmp_path / "a.nacre")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
def test_a_disk_that_fills_up_at_the_last_moment(tmp_path, monkeypatch, code):
    def fail(*_):
        raise OSError(code, os.strerror(code))

    path = write(tmp_path / "a.nacre")
    monkeypatch.setattr("addon.datasets.dataset._move_into_place", fail)
    with pytest.raises(NacreError, match="no room to write") as caught:
        write(path, np.float16)
    assert "\n" not in str(caught.value)
    assert os.listdir(tmp_path) == ["a.nacre"]
    assert open_dataset(path).samples.dtype == np.float32


def test_the_older_dataset_comes_back_when_the_last_rename_fails(tmp_path, monkeypatch):
    path = write(tmp_path / "a.nacre")
    rename = type(path).rename

    def fail_once(self, target):
        if self.suffix == ".partial":
            raise PermissionError(errno.EACCES, "Permission denied")
        return rename(self, target)

    monkeypatch.setattr(type(path), "rename", fail_once)
    with pytest.raises(NacreError, match="cannot write .*Permission denied"):
        write(path, np.float16)
    assert os.listdir(tmp_path) == ["a.nacre"]
    assert open_dataset(path).samples.dtype == np.float32


def test_what_is_no_dataset_is_named(tmp_path):
    with pytest.raises(NacreError, match="there is no dataset"):
        open_dataset(tmp_path / "absent")
    with pytest.raises(NacreError, match="is not a Nacre dataset"):
        open_dataset(tmp_path)
    path = write(tmp_path / "a.nacre")
    (path / "samples.npy").unlink()
    with pytest.raises(NacreError, match="cannot read samples.npy"):
        open_dataset(path)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"nacre": 2}, "newer Nacre"),
        ({"kind": "voxels"}, "of the kind 'voxels'"),
        ({"axes": ["view", "light", "y", "x", "channel"]}, "has other axes"),
        ({"light": [UP]}, "lists 1 lights"),
        ({"light": [UP, [0, 0, 2]]}, "light directions that are not unit vectors"),
        ({"view": "up"}, "view directions that are not unit vectors"),
        ({"view": [UP, UP, [0, 1]]}, "view directions that are not unit vectors"),
        ({"channels": ["R", "G"]}, "2 channels"),
        ({"channels": "RGB"}, "channels that are not names"),
        ({"patch_size": [0, 1]}, "two lengths in metres"),
        ({"patch_size": 1}, "two lengths in metres"),
        ({"periodic": "yes"}, "true or false"),
        ({"noise_floor_db": "low"}, "not a number"),
        ({"source": None}, "not an object"),
    ],
)
def test_a_description_that_breaks_the_layout_is_refused(tmp_path, change, says):
    path = write(tmp_path / "a.nacre")
    (path / "dataset.json").write_text(json.dumps(description(**change)))
    with pytest.raises(NacreError, match=says):
        open_dataset(path)
    # Nor can it be written.
    with pytest.raises(NacreError, match=says):
        write(tmp_path / "b.nacre", **change)
    assert os.listdir(tmp_path) == ["a.nacre"]


@pytest.mark.parametrize("text", ["", "[1]", "{", "{}", '{"nacre": 1}', "[" * 100_000])
def test_a_description_that_is_no_description_is_refused(tmp_path, text):
    path = write(tmp_path / "a.nacre")
    (path / "dataset.json").write_text(text)
    with pytest.raises(NacreError, match="dataset.json"):
        open_dataset(path)


def test_samples_of_another_length_are_refused(tmp_path):
    path = write(tmp_path / "a.nacre")
    data = (path / "samples.npy").read_bytes()
    for cut in (0, 5, 9, 60, len(data) - 1):
        (path / "samples.npy").write_bytes(data[:cut])
        with pytest.raises(NacreError, match=r"samples.npy (is cut short|has a damaged header)"):
            open_dataset(path)
    (path / "samples.npy").write_bytes(data + b"\0\0")
    with pytest.raises(NacreError, match="2 bytes too many"):
        open_dataset(path)


@pytest.mark.parametrize(
    "array",
    [
        samples().astype(np.float64),
        samples().astype(">f4"),
        np.asfortranarray(samples()),
        samples()[0],
        np.zeros((2, 3, 0, 5, 3), np.float32),
        np.zeros((3, 3, 4, 5, 3), np.float32),
    ],
)
def test_samples_of_another_kind_are_refused(tmp_path, array):
    path = write(tmp_path / "a.nacre")
    np.save(path / "samples.npy", array)
    with pytest.raises(NacreError):
        open_dataset(path)


def test_pickled_samples_are_never_loaded(tmp_path):
    path = write(tmp_path / "a.nacre")
    np.save(path / "samples.npy", np.full(SHAPE, None), allow_pickle=True)
    with pytest.raises(NacreError, match="not float16 or float32"):
        open_dataset(path)


@given(data=st.data())
@settings(max_examples=150, deadline=None, derandomize=True)
def test_a_damaged_dataset_opens_or_is_one_clear_error(tmp_path_factory, data):
    path = write(tmp_path_factory.mktemp("damaged") / "a.nacre")
    name = data.draw(st.sampled_from(["samples.npy", "dataset.json"]))
    content = bytearray((path / name).read_bytes())
    reach = min(len(content), 128) if name == "samples.npy" else len(content)
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, reach - 1))] = data.draw(st.integers(0, 255))
    (path / name).write_bytes(content)
    try:
        open_dataset(path)
    except NacreError as error:
        assert "\n" not in str(error)
    shutil.rmtree(path.parent)
