"""The benchmark's materials can be built and measured."""

import importlib

import numpy as np
import pytest

from addon.datasets.directions import spherical_to_unit
from addon.measure.btf import measure_btf
from addon.measure.occlusion import coverage
from addon.measure.settings import Settings
from benchmarks._measured import RECIPES


@pytest.mark.parametrize("name", sorted({*RECIPES, "net"}))
def test_recipe(tmp_path, name):
    patch = importlib.import_module(f"benchmarks.recipes.{name}").build()
    directions = spherical_to_unit([0, 60], [0, 200])
    dataset = measure_btf(patch, tmp_path / "a.nacre", directions, directions, Settings(12, 2))
    values = dataset.samples.astype(np.float32)
    assert values.min() >= 0 and 0.02 < values[0, 0].mean() < 5
    assert (values.std((2, 3)) > 0.005).any(-1).all()
    covered = coverage(patch, directions, (24, 24))
    assert (covered == 1).all() != (name in ("fibre", "net"))
