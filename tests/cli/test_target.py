"""compress --target-db and --target-mb: no one chooses ranks."""

import json
import os
import signal

import pytest

from addon import cli


def test_a_quality(nacre_json, tmp_path):
    said = nacre_json("compress", "small.nacre", tmp_path / "m.exr", "--target-db", "15")
    reached = nacre_json("compare", "small.nacre", tmp_path / "m.exr")["snr_db"]
    assert 15.0 <= reached <= 15.1
    assert said["snr_db"] == pytest.approx(reached, abs=1e-3)
    assert said["target"] == {"snr_db": 15.0}
    assert said["bytes"] == os.path.getsize(tmp_path / "m.exr")
    assert os.listdir(tmp_path) == ["m.exr"]
    curve = said["rate_distortion"]
    assert all(
        point.keys() == {"ranks", "clusters", "mixtures", "snr_db", "bytes"} for point in curve
    )
    landed = {"ranks": said["ranks"], "clusters": said["clusters"], "bytes": said["bytes"]}
    assert any(landed.items() <= point.items() for point in curve)
    kept = nacre_json("info", tmp_path / "m.exr")
    assert kept["rate_distortion"] == curve


@pytest.mark.parametrize("method", ["nsvd", "mkcta"])
def test_a_size(method, nacre_json, tmp_path):
    command = ["compress", "small.nacre", tmp_path / "m.exr", "--method", method]
    said = nacre_json(*command, "--target-mb", "0.011")
    assert said["bytes"] == os.path.getsize(tmp_path / "m.exr") <= 11000
    assert said["method"] == method
    assert said["target"] == {"megabytes": 0.011}


def test_people_read_one_point_of_the_curve_a_line(nacre, tmp_path):
    lines = nacre("compress", "small.nacre", tmp_path / "m.exr", "--target-db", "9").splitlines()
    first = lines.index("rate_distortion") + 1
    assert json.loads(lines[first])["snr_db"] > 0.0
    assert max(map(len, lines)) < 200


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--target-db 0", ["'0'", "above 0"]),
        ("--target-db loud", ["'loud'"]),
        ("--target-db nan", ["'nan'"]),
        ("--target-mb inf", ["'inf'"]),
        ("--target-db 9 --target-mb 1", ["--target-db", "--target-mb"]),
        ("--target-db 9 --ranks light=3", ["--ranks", "target"]),
        ("--target-db 9 --clusters view=3", ["--clusters", "target"]),
        ("--target-mb 9 --mixtures view=3", ["--mixtures", "target"]),
        ("--target-mb 9 --quality high", ["--quality", "target"]),
        ("--target-mb 9 --resume", ["--resume", "target"]),
        ("--target-mb 9 --coarse 2", ["--coarse", "target"]),
        ("--target-db 9 --method svd", ["'svd'"]),
        ("--target-db 9 --global view", ["'view'"]),
        ("--target-db 99", ["small.nacre", "99 dB", "--target-db 66"]),
        ("--target-mb 0.0001", ["small.nacre", "0.0001 MB", "smallest"]),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_one_line_says_what_was_wrong(options, words, nacre, tmp_path):
    command = ["compress", "small.nacre", tmp_path / "m.exr", *options.split()]
    said = nacre(*command, status=2)
    for word in words:
        assert word in said
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("number", [1, 15, 30])
def test_ctrl_c_leaves_nothing(number, nacre, monkeypatch, tmp_path):
    calls = iter(range(1, 100000))

    def progress(self, fraction, message):
        if next(calls) == number:
            signal.raise_signal(signal.SIGINT)
        return True

    monkeypatch.setattr(cli.Progress, "__call__", progress)
    command = ["compress", "small.nacre", tmp_path / "m.exr", "--target-db", "12"]
    assert nacre(*command, status=130) == "nacre: cancelled\n"
    assert os.listdir(tmp_path) == []
