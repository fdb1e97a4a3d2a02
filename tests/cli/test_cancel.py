"""Ctrl-C: one line, status 130, and nothing half-written stays behind."""

import os
import signal

import pytest

from addon import cli, samples

VERBS = pytest.mark.parametrize(
    "command",
    [
        "import good.btf OUT/new.nacre",
        "compress small.nacre OUT/m.exr",
        "compress small.nacre OUT/m.exr --method nsvd",
        "export small.nacre OUT/m.btf",
        "export small.nacre OUT/m.zip",
        "decode kcta.exr OUT/new.nacre",
        "decode kcta.exr OUT/new.nacre --directions some.csv",
    ],
)


@pytest.fixture
def out(tmp_path, files):
    """A folder with an older model and dataset of the names that are written."""
    os.link(files / "nsvd.exr", tmp_path / "m.exr")
    return tmp_path


@pytest.fixture
def interrupt(monkeypatch):
    """A function that lets Ctrl-C come with the n-th report of progress."""
    monkeypatch.setattr(samples, "BLOCK_BYTES", 1)  # there are reports enough then

    def at(number):
        calls = iter(range(1, 1000))

        def progress(self, fraction, message):
            if next(calls) == number:
                signal.raise_signal(signal.SIGINT)
            return True

        monkeypatch.setattr(cli.Progress, "__call__", progress)

    return at


@VERBS
@pytest.mark.parametrize("number", [1, 2])
def test_ctrl_c_leaves_nothing(command, number, nacre, interrupt, out, listing):
    before, model = listing(), (out / "m.exr").read_bytes()
    interrupt(number)
    said = nacre(*command.replace("OUT", str(out)).split(), status=130)
    assert said == "nacre: cancelled\n"
    assert os.listdir(out) == ["m.exr"]
    assert (out / "m.exr").read_bytes() == model
    assert listing() == before


@VERBS
def test_a_no_of_the_progress_is_a_cancel(command, nacre, monkeypatch, tmp_path):
    monkeypatch.setattr(cli.Progress, "__call__", lambda *_: False)
    said = nacre(*command.replace("OUT", str(tmp_path)).split(), status=2)
    assert said == "nacre: cancelled\n"
    assert os.listdir(tmp_path) == []


def test_compare_can_be_stopped(nacre, interrupt, monkeypatch):
    interrupt(1)
    assert nacre("compare", "small.nacre", "kcta.exr", status=130) == "nacre: cancelled\n"
    monkeypatch.setattr(cli.Progress, "__call__", lambda *_: False)
    assert nacre("compare", "small.nacre", "kcta.exr", status=2) == "nacre: cancelled\n"
