"""Both cameras see the same: all views in one picture, and one after the other without OSL."""

from __future__ import annotations

import numpy as np
import pytest

from addon.datasets.direction_sets import direction_set
from addon.measure import instrument
from addon.measure.btf import measure_btf
from addon.measure.occlusion import coverage
from addon.measure.patch import Patch
from addon.measure.settings import Settings

VIEW = direction_set("ubo81")[[0, 5, 13, 40, 80]]
QUADS = (
    ((-0.5, -0.5), (0.5, 0.5), -0.1, (0.8, 0.8, 0.8)),
    ((-0.375, -0.25), (0.125, 0.0), 0.2, (1, 0.1, 0)),
)


@pytest.fixture
def without_osl(monkeypatch):
    monkeypatch.setattr(instrument, "has_osl", lambda: False)


@pytest.mark.parametrize(
    ("size", "width"), [((1, 1), 16), ((1, 0.5), 16), ((1, 1), 2), ((1, 1), 1)]
)
def test_same_samples(tmp_path, make_patch, monkeypatch, size, width):
    patch = Patch(make_patch(*QUADS).collection, size)
    settings = Settings(width, 256, bounces=1)
    found = []
    for osl in (True, False):
        monkeypatch.setattr(instrument, "has_osl", lambda osl=osl: osl)
        path = tmp_path / f"{osl}.nacre"
        found.append(measure_btf(patch, path, VIEW[:2], VIEW, settings))
    first, second = (dataset.samples.astype(float) for dataset in found)
    assert first.shape == second.shape
    assert np.abs(first - second).mean() < 0.02 * first.mean()
    assert abs(first.mean() / second.mean() - 1) < 5e-3
    assert found[0].source["measurement"]["program"] != found[1].source["measurement"]["program"]
    assert abs(found[0].noise_floor_db - found[1].noise_floor_db) < 3


def test_same_coverage(make_patch, monkeypatch):
    """Edges between texels' centres, so that rays a hundredth of a texel off see the same."""
    patch = make_patch(((-0.4, -0.3), (0.22, 0.17), 0.11, (1, 1, 1)))
    first = coverage(patch, VIEW, (16, 16))
    monkeypatch.setattr(instrument, "has_osl", lambda: False)
    np.testing.assert_array_equal(coverage(patch, VIEW, (16, 16)), first)
    assert 0.2 < first.mean() < 0.4


def test_seeds_differ_from_view_to_view(make_patch, without_osl):
    above = ((-0.3, -0.2), (0.3, 0.3), 0.4, (0, 1, 0))
    view = np.repeat(VIEW[3:4], 3, 0)
    with instrument.new_instrument(make_patch(*QUADS, above), view, VIEW, (8, 8), 2, 1) as found:
        from addon.measure.cycles import add_light, aim

        aim(add_light(found.scene), VIEW[3])
        first = found.picture(0)
        assert np.abs(first[0] - first[1]).mean() > 1e-3
        np.testing.assert_array_equal(found.picture(0), first)
        np.testing.assert_array_equal(found.picture(0, 1), first[2:])
