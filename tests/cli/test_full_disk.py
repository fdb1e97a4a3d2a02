"""A disk that is full, by a limit on the size of files and by a small disk of its own."""

import json
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from small_btf import write_dataset

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = "--method kcta --ranks light=8,view=4,y=16,x=16 --clusters view=3 --mixtures view=2"


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("full")
    return write_dataset(folder / "d.nacre", (8, 9, 24, 24, 3)).path


def nacre(*command, limit=resource.RLIM_INFINITY, prefix=()):
    """Run the command line; `limit` is on the bytes of a file."""
    script = (
        f"import resource, runpy; resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit})); "
        "runpy.run_module('addon', run_name='__main__')"
    )
    return subprocess.run(
        [*prefix, sys.executable, "-c", script, *map(str, command)],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )


def refused(run, folder):
    """It gave one line, and left nothing in the folder."""
    assert run.returncode == 2
    assert run.stdout == ""
    assert run.stderr.startswith("nacre: no room to write ")
    assert run.stderr.count("\n") == 1
    assert "free space" in run.stderr
    assert list(folder.iterdir()) == []


def test_files_that_may_not_grow_are_not_left(dataset, tmp_path):
    compress = ["compress", dataset, tmp_path / "m.exr", *SETTINGS.split(), "--json"]
    run = nacre(*compress)
    assert (run.returncode, run.stderr) == (0, "")
    size = json.loads(run.stdout.splitlines()[-1])["bytes"]
    model = shutil.move(tmp_path / "m.exr", dataset.with_name("m.exr"))
    # At once, and when all but the last bytes are there.
    for command, limit in (
        (compress, 4096),
        (compress, size - 10),
        (["decode", model, tmp_path / "d.nacre", "--json"], 4096),
        (["decode", model, tmp_path / "d.nacre", "--json"], 8 * 9 * 24 * 24 * 3 * 4),
    ):
        refused(nacre(*command, limit=limit), tmp_path)


def small_disk(folder, size):
    """A prefix for a command that then sees a disk of `size` at `folder`, and nobody else does; it
    prints what is on the disk at the end."""
    script = f'mount -t tmpfs -o size={size} none "$0" && "$@"; code=$?; ls -A "$0"; exit $code'
    return ("unshare", "--mount", "--map-root-user", "sh", "-c", script, str(folder))


@pytest.fixture(scope="module")
def mounting(tmp_path_factory):
    folder = tmp_path_factory.mktemp("disk")
    if not shutil.which("unshare"):
        pytest.skip("there is no unshare to mount a small disk with")
    run = subprocess.run([*small_disk(folder, "64k"), "true"], capture_output=True, text=True)
    if run.returncode:
        pytest.skip(f"mounting a small disk is not allowed: {run.stderr.strip()}")


@pytest.mark.parametrize("size", ["12k", "20k", "28k"])
def test_a_small_disk_is_left_empty(size, dataset, tmp_path, mounting):
    disk = tmp_path / "disk"
    disk.mkdir()
    command = ["compress", dataset, disk / "m.exr", *SETTINGS.split()]
    refused(nacre(*command, prefix=small_disk(disk, size)), disk)


def test_a_disk_that_is_large_enough_will_do(dataset, tmp_path, mounting):
    disk = tmp_path / "disk"
    disk.mkdir()
    command = ["compress", dataset, disk / "m.exr", *SETTINGS.split(), "--json"]
    run = nacre(*command, prefix=small_disk(disk, "1m"))
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout.splitlines()[-1] == "m.exr"
