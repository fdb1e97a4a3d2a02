"""The scripts in samples/ build scenes that can be measured and that repeat."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.datasets.direction_sets import direction_set
from addon.measure.btf import measure_btf
from addon.measure.patch import open_patch
from addon.measure.scene_file import find_item, open_scene
from addon.measure.settings import Settings

SAMPLES = Path(__file__).resolve().parents[2] / "samples"
SIZES = {"woven_hair": 0.012, "displaced_voronoi": 0.02, "translucent_wax": None}


@pytest.mark.parametrize("name", SIZES)
def test_scene(tmp_path, name):
    path = tmp_path / "a.blend"
    script = str(SAMPLES / f"{name}.py")
    subprocess.run([sys.executable, script, str(path)], check=True, stdout=subprocess.DEVNULL)
    open_scene(path)
    size = SIZES[name] and (SIZES[name], SIZES[name])
    directions = direction_set("uniform:2")
    with open_patch(find_item(None, None), size) as patch:
        dataset = measure_btf(
            patch, tmp_path / "a.nacre", directions, directions, Settings(24, 8, bounces=2)
        )
    assert dataset.patch_size == pytest.approx((SIZES[name] or 0.02,) * 2)
    values = dataset.samples.astype(np.float32)
    assert 0.02 < values[0, 0].mean() < 1.5
    # No seam: texels on both sides of the edge differ no more than others do.
    for axis in (2, 3):
        step = np.abs(values - np.roll(values, 1, axis)).mean((0, 1, 4, 5 - axis))
        assert step[0] < 1.6 * step.mean()
    bpy.ops.wm.read_factory_settings(use_empty=True)
