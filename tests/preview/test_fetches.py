"""The shader counts its own fetches: no more than the tables' nonzeros need."""

from __future__ import annotations

import pytest

from benchmarks._glsl import Screen
from benchmarks._tables import random_tables
from benchmarks.glsl import MATERIALS

pytestmark = pytest.mark.usefixtures("need_gpu")


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("suns", [1, 3])
def test_the_papers_materials_take_what_their_nonzeros_need(name, suns):
    shape, (once, each), (index, index_each) = MATERIALS[name]
    screen = Screen(random_tables(*shape, texels=16), (8, 8), suns)
    counted = screen.pixels(screen.counted())
    assert counted.min() == counted.max() == once + index + (each + index_each) * suns


def test_the_tables_description_counts_the_same():
    tables = random_tables((1, 4), (1, 2), (7, 9), texels=8)
    screen = Screen(tables, (8, 8), 1)
    assert screen.pixels(screen.counted()).max() == sum(tables.fetches.values())


def test_two_levels_are_two_taps_of_the_core_alone(monkeypatch):
    monkeypatch.setattr("benchmarks._glsl.MAGNIFIED", 1 / 3)
    tables = random_tables((1, 4), (1, 2), (8, 8), texels=8)
    screen = Screen(tables, (8, 8), 2)
    fetches = tables.fetches
    expected = 2 * fetches["core"] + fetches["view"] + fetches["index"] + 2 * fetches["light"]
    assert screen.pixels(screen.counted()).max() == expected
