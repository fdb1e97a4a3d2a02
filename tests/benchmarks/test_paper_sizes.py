"""Our count of stored numbers gives the sizes that the papers print."""

from types import SimpleNamespace

import pytest

from benchmarks._papers import KCTA, MKCTA, kcta_settings, mkcta_settings


# Fiber's and RoughHole's sizes hold their occlusion textures.
@pytest.mark.parametrize("name", ["Corduroy", "Sponge", "Wool"])
def test_sizes_of_k_cta(name):
    paper = KCTA[name]
    dataset = SimpleNamespace(shape=(*paper.shape, 3))
    sizes = [settings.mb(dataset.shape) for settings in kcta_settings(dataset, paper)]
    assert [round(size, 2) for size in sizes] == pytest.approx(paper.mb, abs=0.011)


@pytest.mark.parametrize("name", MKCTA)
def test_sizes_of_mk_cta(name):
    paper = MKCTA[name]
    dataset = SimpleNamespace(shape=(*paper.shape, 3))
    sizes = [settings.mb(dataset.shape) for settings in mkcta_settings(dataset, paper)]
    assert [round(size, 2) for size in sizes] == pytest.approx(paper.mb, abs=0.011)
