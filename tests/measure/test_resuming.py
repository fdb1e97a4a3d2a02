"""A measurement that is killed or cut into parts gives the same dataset, bit for bit."""

from __future__ import annotations

import random
import shutil
import subprocess
import sys
import time
from pathlib import Path

import measured_monkey
import numpy as np
import pytest

from addon.datasets.direction_sets import direction_set
from addon.errors import Cancelled, NacreError
from addon.measure.btf import measure_btf
from addon.measure.merging import merge_parts
from addon.measure.settings import Settings
from addon.measure.unfinished import count_finished, unfinished_folder

HERE = Path(__file__).resolve().parent
UP = np.array([[0.0, 0.0, 1.0]])
QUAD = ((-0.5, -0.5), (0.2, 0.3), 0, (1, 0.5, 0.2))


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "a.nacre"
    measured_monkey.measure(path)
    return path


def _assert_same(first: Path, second: Path) -> None:
    names = sorted(path.name for path in first.iterdir())
    assert names == sorted(path.name for path in second.iterdir())
    for name in names:
        assert (first / name).read_bytes() == (second / name).read_bytes(), name


def _killed_at_random(folder: Path, whole: Path, times: int, seed: int) -> None:
    """Kill a measurement `times` times, then let it end; each kill loses at most one picture."""
    chance = random.Random(seed)
    path = folder / "a.nacre"
    for _ in range(times):
        before = count_finished(path)
        process = subprocess.Popen(
            [sys.executable, str(HERE / "measured_monkey.py"), str(path)],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert process.stdout is not None
        begun = 0
        for line in process.stdout:  # wait for pictures, so that each run gets somewhere
            begun += "Measuring light" in line
            if begun > chance.randint(0, 2):
                time.sleep(chance.uniform(0, 0.1))
                break
        process.kill()
        rest = process.communicate()[0]
        begun += rest.count("Measuring light")
        if path.exists():
            break
        assert count_finished(path) >= before + begun - 1
    measured_monkey.measure(path)
    _assert_same(path, whole)
    assert [item.name for item in folder.iterdir()] == ["a.nacre"]


def test_killed_and_resumed(tmp_path, whole):
    _killed_at_random(tmp_path, whole, 2, 1)


@pytest.mark.acceptance
@pytest.mark.parametrize("seed", range(10))
def test_killed_at_ten_random_points(tmp_path, whole, seed):
    _killed_at_random(tmp_path, whole, 1, 100 + seed)


@pytest.mark.acceptance
def test_killed_ten_times_in_a_row(tmp_path, whole):
    _killed_at_random(tmp_path, whole, 10, 3)


def test_damaged_picture_is_taken_again(tmp_path, whole):
    path = tmp_path / "a.nacre"
    with pytest.raises(Cancelled):
        measured_monkey.measure(path, stop_at="Measuring light 8")
    pictures = sorted(unfinished_folder(path).glob("[0-9]*.npz"))
    data = pictures[2].read_bytes()
    pictures[1].write_bytes(data[: len(data) // 2])
    pictures[2].write_bytes(data[:-3000] + b"x" + data[-2999:])
    measured_monkey.measure(path)
    _assert_same(path, whole)


@pytest.mark.parametrize("count", [2, 5, 12])
def test_parts_merge_to_the_whole(tmp_path, whole, count):
    parts = []
    for number in range(1, count + 1):
        parts.append(tmp_path / f"part{number}.nacre")
        measured_monkey.measure(parts[-1], part=(number, count))
    merge_parts(parts[::-1], tmp_path / "a.nacre")
    _assert_same(tmp_path / "a.nacre", whole)


def test_merging_mistakes(tmp_path, make_patch):
    light = np.repeat(UP, 4, 0)
    patch = make_patch(QUAD)

    def part(name: str, number: int, samples: int = 1) -> Path:
        measure_btf(patch, tmp_path / name, light, UP, Settings(2, samples), part=(number, 4))
        return tmp_path / name

    parts = [part(f"{number}.nacre", number) for number in (1, 2, 3, 4)]
    shutil.copytree(parts[2], tmp_path / "again.nacre")
    out = tmp_path / "a.nacre"
    for given, problem in (
        (parts[:3], "no part has the lights 4 to 4"),
        (parts[2:], "no part has the lights 1 to 2"),
        ([*parts, tmp_path / "again.nacre"], "has lights that another part has, too"),
        ([*parts[:3], part("other.nacre", 4, 2)], "was measured with other samples"),
    ):
        with pytest.raises(NacreError, match=problem):
            merge_parts(given, out)
        assert not out.exists()
    with pytest.raises(Cancelled):
        merge_parts(parts, out, lambda fraction, message: fraction < 0.5)
    assert not out.exists()


def test_more_parts_than_lights(tmp_path, make_patch):
    with pytest.raises(NacreError, match="part 1 of 3 is empty: there are 2 lights"):
        measure_btf(
            make_patch(QUAD), tmp_path / "a.nacre", np.repeat(UP, 2, 0), UP, Settings(2, 1),
            part=(1, 3),
        )  # fmt: skip
    assert not list(tmp_path.iterdir())


def test_unfinished_measurement_of_something_else(tmp_path, make_patch):
    patch, path = make_patch(QUAD), tmp_path / "a.nacre"
    light = np.repeat(UP, 3, 0)

    def measure(samples: int, fraction: float = 2.0, **options):
        return measure_btf(
            patch, path, light, UP, Settings(2, samples), progress=lambda done, _: done < fraction,
            **options,
        )  # fmt: skip

    with pytest.raises(Cancelled):
        measure(1, 0.5, origin="first")
    with pytest.raises(NacreError, match="unfinished measurement with other samples"):
        measure(2, origin="first")
    with pytest.raises(NacreError, match="but the scene was saved since: resume"):
        measure(1, origin="second")
    assert count_finished(path) == 2
    assert measure(1, origin="second", resume=True).source["measurement"]["origin"] == "second"
    with pytest.raises(Cancelled):
        measure(1, 0.5)
    assert measure(2, restart=True).source["measurement"]["samples"] == 2
    assert not unfinished_folder(path).exists()


def test_noise_target(tmp_path, make_patch):
    below, above = (
        ((-0.5, -0.5), (0.5, 0.5), 0, (1, 1, 1)),
        ((-0.3, -0.2), (0.3, 0.3), 0.4, (0, 1, 0)),
    )
    patch = make_patch(below, above)
    view = direction_set("uniform:9")
    found = {}
    for target in (15.0, 25.0):
        dataset = measure_btf(patch, tmp_path / "a.nacre", view, view, Settings(8, noise_db=target))
        found[target] = dataset.source["measurement"]["samples"]
        assert target - 1 < dataset.noise_floor_db < target + 6
    assert found[25.0] > 2 * found[15.0]
