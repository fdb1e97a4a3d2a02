"""These tests use the small models and measured files of other folders' tests."""

import json
import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / "models"), str(TESTS / "datasets")]

import image_zips  # noqa: E402
from btf_writer import BtfFile  # noqa: E402
from small_btf import make_model, write_dataset  # noqa: E402

from addon.cli import main  # noqa: E402
from addon.datasets.dataset import open_dataset  # noqa: E402
from addon.models.exr import save_model  # noqa: E402
from addon.models.fit import compress  # noqa: E402

SHAPE = (6, 7, 8, 10, 3)
RANKS = {"light": 5, "view": 3, "y": 4, "x": 5}


@pytest.fixture(autouse=True)
def interruptible():
    """Ctrl-C as on a terminal, also where the tests run in the background and ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def files(tmp_path_factory):
    """A folder with one of everything, and everything that can be wrong with it."""
    folder = tmp_path_factory.mktemp("files")
    dataset = write_dataset(folder / "small.nacre", SHAPE)
    write_dataset(folder / "other.nacre", (6, 7, 8, 9, 3))
    kcta = {"ranks": RANKS, "clusters": {"view": 3}, "mixtures": {"view": 2}}
    save_model(compress(dataset, "kcta", **kcta), folder / "kcta.exr")
    save_model(compress(dataset, "nsvd", ranks=RANKS), folder / "nsvd.exr")
    mkcta = {"clusters": {"light": 2, "view": 3}, "mixtures": {"light": 2, "view": 2}}
    save_model(make_model(SHAPE, (3, 2, 4, 5), **mkcta, shared=("y", "x")), folder / "mkcta.exr")
    save_model(compress(dataset, "nsvd", ranks=RANKS, domain="log"), folder / "log.exr")
    (folder / "some.csv").write_text("theta,phi\n0,0\n30,45\n60,200\n85,300\n")
    (folder / "below.csv").write_text("theta,phi\n0,0\n95,0\n")
    (folder / "angles.csv").write_text("0,0\n")
    (folder / "good.btf").write_bytes(BtfFile().to_bytes())
    image_zips.write_zip(folder / "good.zip", image_zips.usual_files())
    rng = np.random.default_rng(0)
    for name in ("a.png", "b.png"):
        Image.fromarray(rng.integers(0, 256, (6, 5, 3), dtype=np.uint8)).save(folder / name)
    Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(folder / "tiny.png")
    for name in ("kcta.exr", "good.btf", "good.zip", "a.png"):
        data = (folder / name).read_bytes()
        (folder / f"cut{Path(name).suffix}").write_bytes(data[: len(data) * 2 // 3])
    (folder / "text.exr").write_text("not a picture")
    (folder / "empty.nacre").mkdir()
    write_dataset(folder / "cut.nacre", SHAPE)
    os.truncate(folder / "cut.nacre" / "samples.npy", 1000)
    return folder


@pytest.fixture
def listing(files):
    """A function that says what is in `files`, to see that nothing is left there."""

    def names():
        return sorted(str(path.relative_to(files)) for path in files.rglob("*"))

    return names


@pytest.fixture
def nacre(files, monkeypatch, capfd):
    """A function that runs the command line in `files`: what it printed when it succeeded, the one
    line on standard error when it did not."""
    monkeypatch.chdir(files)

    def run(*arguments, status=0):
        assert main([str(argument) for argument in arguments]) == status
        out, err = capfd.readouterr()
        if status == 0:
            assert err == ""
            return out
        assert out == ""
        assert err.startswith("nacre: ")
        assert err.endswith("\n")
        assert err.count("\n") == 1
        return err

    return run


@pytest.fixture
def nacre_json(nacre):
    """A function that runs the command line with --json: the object it printed."""
    return lambda *arguments: json.loads(nacre(*arguments, "--json").splitlines()[-1])


@pytest.fixture
def small(files):
    return open_dataset(files / "small.nacre")
