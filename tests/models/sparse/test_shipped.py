"""The ensembles that Nacre comes with."""

import numpy as np
import pytest
from small_btf import write_dataset

from addon.datasets.direction_sets import direction_set
from addon.models.sparse.coding import code
from addon.models.sparse.ensemble import choose, largest_misfit
from addon.models.sparse.files import SHIPPED, ensembles_of, load_ensemble


@pytest.mark.parametrize("directions", ["ubo81", "ubo151"])
def test_there_is_one_for_each_set_of_bonn(directions):
    ensemble = load_ensemble(SHIPPED / f"{directions}.exr")
    for own in (ensemble.light, ensemble.view):
        np.testing.assert_allclose(own, direction_set(directions), atol=1e-6)
    for modes in ensemble.dictionaries.values():
        assert largest_misfit(modes) < 1e-6
    assert not {"wool", "satin"} & set(ensemble.training["materials"])  # figures are of unseen ones


def test_it_is_taken_where_no_other_is_given(tmp_path):
    """Of bumps of paper: nothing like it was trained on."""
    measured = direction_set("ubo81")
    rng = np.random.default_rng(0)
    tilt = 0.3 * rng.normal(size=(8, 8, 2))
    normal = np.concatenate([tilt, np.ones((8, 8, 1))], -1)
    lit = np.maximum(np.einsum("lc,yxc->lyx", measured, normal), 0)
    samples = np.broadcast_to(lit[:, None, ..., None], (81, 81, 8, 8, 3)).astype(np.float32)
    names = measured.tolist()
    dataset = write_dataset(tmp_path / "a.nacre", samples.shape, samples, light=names, view=names)
    ensemble = choose(ensembles_of([]), dataset)
    assert len(ensemble.light) == 81
    coarse, fine = (code(dataset, ensemble, quality).fit["snr_db"] for quality in (4, 64))
    assert fine > coarse + 3 > 13
