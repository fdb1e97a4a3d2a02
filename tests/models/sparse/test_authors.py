"""The ensembles and codes that the authors published."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from trained import one_line

from addon.errors import NacreError
from addon.models.sparse import authors
from addon.models.sparse.ensemble import largest_misfit
from addon.models.sparse.files import (
    load_ensemble,
)

SHARED = Path(os.environ.get("NACRE_SHARED_DATA", "/nowhere")) / "sparsebtf"
published = pytest.mark.skipif(not SHARED.is_dir(), reason="the authors' files are not here")


@published
def test_the_published_ensembles_load():
    from addon.datasets.direction_sets import direction_set

    ensemble = load_ensemble(SHARED)
    assert ensemble.patch == (10, 10) and list(ensemble.dictionaries) == ["Y", "U", "V"]
    for modes in ensemble.dictionaries.values():
        assert [m.shape for m in modes] == [(8, n, n) for n in (10, 10, 151, 151)]
        assert largest_misfit(modes) < 1e-6
    np.testing.assert_allclose(ensemble.light, direction_set("ubo151"), atol=1e-3)


@published
@pytest.mark.parametrize("channel", ["U", "V"])
def test_published_codes_give_plausible_pictures(channel):
    folder = SHARED / "coefficients"
    ensemble = load_ensemble(SHARED)
    positions, values, members = authors.load_authors_codes(
        folder / f"Coeffs_BTF_carpet07_1e-05_{channel}.bin"
    )
    assert positions.shape == values.shape == (1600, 64)
    picture = np.empty((400, 400))
    light, view = 40, 0
    for patch in range(1600):
        y, x, lights, views = np.unravel_index(positions[patch], (10, 10, 151, 151))
        u = [matrices[members[patch]] for matrices in ensemble.dictionaries[channel]]
        weighed = values[patch] * u[2][light, lights] * u[3][view, views]
        block = np.einsum("c,yc,xc->yx", weighed, u[0][:, y], u[1][:, x])
        row, column = divmod(patch, 40)
        picture[10 * row : 10 * row + 10, 10 * column : 10 * column + 10] = block
    normalised = authors.load_authors_normalisation(folder / "carpet07_mean_std.bin")
    chroma = picture * normalised.deviation[light, view] + normalised.mean[light, view, 1]
    assert np.isfinite(chroma).all()
    assert np.abs(chroma).max() < 3  # of log RGB: a carpet has little colour
    # 64 coefficients for all lights and views leave seams, but fewer than patches turned over.
    blocks = picture.reshape(40, 10, 40, 10)
    turned = blocks[:, ::-1].reshape(400, 400), blocks[..., ::-1].reshape(400, 400)
    for axis, other in enumerate(turned):
        assert seams(picture, axis) < 0.8 * seams(other, axis)


def seams(picture, axis):
    """How large the steps between patches are."""
    steps = np.abs(np.diff(picture, axis=axis))
    return np.take(steps, np.arange(9, 399, 10), axis).mean()


@published
def test_damaged_published_files_are_refused(tmp_path):
    for name in ("bonn_angles.bin", "dictionaries"):
        copy = shutil.copytree if (SHARED / name).is_dir() else shutil.copyfile
        copy(SHARED / name, tmp_path / name)
    target = tmp_path / "dictionaries" / "DictEnsOrth4DU.bin"
    target.chmod(0o644)
    target.parent.chmod(0o755)
    whole = target.read_bytes()
    for content, word in ((whole[:-2], "expected"), (bytes(len(whole)), "orthonormal")):
        target.write_bytes(content)
        with pytest.raises(NacreError) as error:
            load_ensemble(tmp_path)
        one_line(error, "DictEnsOrth4DU.bin", word)
    target.unlink()
    with pytest.raises(NacreError) as error:
        load_ensemble(tmp_path)
    one_line(error, "cannot be read")
    codes = tmp_path / "c.bin"
    codes.write_bytes((SHARED / "coefficients/Coeffs_BTF_carpet07_1e-05_U.bin").read_bytes()[:-6])
    with pytest.raises(NacreError) as error:
        authors.load_authors_codes(codes)
    one_line(error, "c.bin")
