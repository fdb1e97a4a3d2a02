"""Files in zips and folders: nothing outside is read, nothing absurd is unpacked."""

import os
import zipfile

import pytest

from addon.datasets.images.archive import open_files
from addon.errors import NacreError


def make_zip(path, files):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return path


def make_folder(path, files):
    for name, data in files.items():
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(data)
    return path


FILES = {
    "a.png": b"one",
    "deep/in/b.png": b"two",
    ".hidden": b"",
    "__MACOSX/a.png": b"",
    "deep/.DS_Store": b"",
    "Icon\r": b"",
}


@pytest.fixture(params=[make_zip, make_folder])
def path(request, tmp_path):
    return request.param(tmp_path / "set", FILES)


def test_names_sizes_and_content(path):
    with open_files(path) as files:
        assert sorted(files.names()) == ["a.png", "deep/in/b.png"]
        assert files.read("deep/in/b.png") == b"two"
        assert 3 <= files.size("a.png") <= 5
        for read in (files.read, files.size):
            with pytest.raises(NacreError, match="c.png"):
                read("c.png")


@pytest.mark.parametrize("name", ["../secret", "deep/../../secret", "/etc/hostname", "c:/secret"])
def test_nothing_outside_is_read(path, name):
    (path.parent / "secret").write_bytes(b"secret")
    with open_files(path) as files:
        for read in (files.read, files.size):
            with pytest.raises(NacreError, match="outside of the folder|there is no .* in the zip"):
                read(name)


@pytest.mark.skipif(os.name == "nt", reason="links need rights")
def test_a_link_that_leads_out_of_a_folder_is_not_followed(tmp_path):
    (tmp_path / "secret").write_bytes(b"secret")
    folder = make_folder(tmp_path / "set", FILES)
    (folder / "c.png").symlink_to(tmp_path / "secret")
    with open_files(folder) as files, pytest.raises(NacreError, match="leads out of the folder"):
        files.read("c.png")


def test_names_in_a_zip_that_lead_outside_are_only_names(tmp_path):
    path = make_zip(tmp_path / "set", {"../../evil.png": b"evil", "/abs.png": b"abs"})
    with open_files(path) as files:
        assert files.read("../../evil.png") == b"evil"
    assert os.listdir(tmp_path) == ["set"]


def test_what_unpacks_to_far_too_much_is_refused(tmp_path):
    files = {"zeros.png": bytes(2**24 + 1), "small.png": bytes(2**24)}
    with open_files(make_zip(tmp_path / "set", files)) as opened:
        assert len(opened.read("small.png")) == 2**24
        with pytest.raises(NacreError, match="zeros.png is too large for an image in a zip"):
            opened.read("zeros.png")


def test_a_huge_file_in_a_folder_is_refused(tmp_path):
    with (tmp_path / "huge.png").open("wb") as file:
        file.truncate(2**28 + 1)
    with open_files(tmp_path) as files, pytest.raises(NacreError, match="huge.png is too large"):
        files.read("huge.png")


def test_a_damaged_entry_is_one_clear_error(tmp_path):
    path = make_zip(tmp_path / "set", {"a.png": bytes(range(200))})
    data = bytearray(path.read_bytes())
    data[60] ^= 1
    path.write_bytes(data)
    with (
        open_files(path) as files,
        pytest.raises(NacreError, match="a.png cannot be read") as error,
    ):
        files.read("a.png")
    assert "\n" not in str(error.value)
