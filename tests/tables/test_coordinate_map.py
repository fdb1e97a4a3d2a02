"""Coordinate maps: patches laid anew without seams and without repetition."""

import numpy as np
import pytest

from addon.errors import Cancelled, NacreError
from addon.tables import coordinate_map
from addon.tables.coordinate_map import synthesize_coordinates
from addon.tables.evaluate import evaluate_patch
from addon.tables.parabolic import texel_directions
from addon.tables.tables import Tables, quads

NORMAL = np.array([[0.0, 0.0, 1.0]])


def tables_of(picture, size=16):
    """Tables of a flat matt print (Y, X, 3)."""
    cosine = np.maximum(texel_directions(size)[..., 2], 0.0)
    light = cosine[..., None] * np.eye(3)[:, None, None]  # (channel, N, N, rank)
    index = np.zeros((1, size, size), np.uint32)
    return Tables(
        core=quads(np.moveaxis(picture, -1, 0)[None, None, ..., None])[:, :, :, None, ..., 0, :],
        light=quads(light[None, :, None])[..., 0, :][:, :, :, None],
        view=quads(np.ones((1, 1, 1, size, size, 1)))[..., 0, :],
        light_index=index,
        view_index=index,
    )


def spots(height=32, width=32, seed=0):
    """Soft spots without order that wrap round."""
    rng = np.random.default_rng(seed)
    y, x = (np.fft.fftfreq(size) for size in (height, width))
    kernel = np.exp(-2.0 * (np.pi * 1.2) ** 2 * (y[:, None] ** 2 + x**2))
    noise = rng.standard_normal((height, width, 3)) @ rng.random((3, 3))
    smooth = np.fft.ifft2(np.fft.fft2(noise, axes=(0, 1)) * kernel[..., None], axes=(0, 1)).real
    return np.clip(0.5 + 0.25 * smooth / smooth.std(), 0.02, 1.0)


def seam(found, picture):
    """How far colours beside a cut are from those that stood there in the patch (RMS), over the
    differences of any neighbours in the patch; and the share of texels with a cut."""
    bounds = np.array(picture.shape[:2])
    differences, cuts = [], []
    for axis in (0, 1):
        beside = np.roll(found, -1, axis)  # round the map's border too
        stood = (found + np.eye(2, dtype=int)[axis]) % bounds
        cut = (beside != stood).any(-1)
        change = picture[beside[..., 0], beside[..., 1]] - picture[stood[..., 0], stood[..., 1]]
        differences.append((change[cut] ** 2).sum(-1))
        cuts.append(cut.mean())
    own = ((picture - np.roll(picture, -1, 1)) ** 2).sum(-1).mean()
    return np.sqrt(np.concatenate(differences).mean() / own), np.mean(cuts)


def repeated(found, picture):
    """The share of texels that are seen again where the patch would repeat."""
    return np.mean(
        [(found == np.roll(found, size, axis)).all(-1).mean() for axis, size in
         enumerate(picture.shape[:2])]
    )  # fmt: skip


def test_the_print_is_what_is_seen():
    picture = spots()
    np.testing.assert_allclose(
        evaluate_patch(tables_of(picture), NORMAL, NORMAL)[0, 0], picture, rtol=1e-5
    )


@pytest.mark.parametrize("shape", [(32, 32), (24, 40)])
def test_spots_are_laid_anew_without_seams(shape, monkeypatch):
    picture = spots(*shape)
    found = synthesize_coordinates(tables_of(picture), 128, seed=3).astype(int)
    assert found.shape == (128, 128, 2)
    assert (found >= 0).all() and (found < shape).all()
    assert repeated(found, picture) < 0.15  # of a plain tiling: 1
    error, cuts = seam(found, picture)
    assert cuts < 0.35 and error < 1.2
    # Squares that are only moved show what a seam is.
    monkeypatch.setattr(coordinate_map, "_PASSES", 0)
    plain = synthesize_coordinates(tables_of(picture), 128, seed=3).astype(int)
    assert seam(plain, picture)[0] > 1.8 * error


def test_the_whole_patch_is_used():
    found = synthesize_coordinates(tables_of(spots()), 128).astype(int)
    assert len(np.unique(found @ (32, 1))) > 0.9 * 32 * 32


def test_what_is_woven_stays_in_order():
    """Threads every 8 texels, each texel a little different: a plain tiling but for that."""
    y, x = np.mgrid[:32, :32]
    weave = 0.5 + 0.3 * np.sign(
        np.sin(2 * np.pi * (x + 0.5) / 8) * np.sin(2 * np.pi * (y + 0.5) / 8)
    )
    picture = weave[..., None] + 0.1 * spots(seed=2)
    found = synthesize_coordinates(tables_of(picture), 128, seed=1)
    shown = weave[found[..., 0], found[..., 1]]
    assert (shown == np.tile(weave, (4, 4))).mean() > 0.97
    assert repeated(found, picture) < 0.2


def test_a_seed_makes_one_map():
    tables = tables_of(spots())
    first = synthesize_coordinates(tables, 64, seed=5)
    assert first.dtype == np.uint16
    np.testing.assert_array_equal(first, synthesize_coordinates(tables, 64, seed=5))
    assert (first != synthesize_coordinates(tables, 64, seed=6)).any()


def test_a_size_that_does_not_fit():
    with pytest.raises(NacreError, match="multiple of 16") as caught:
        synthesize_coordinates(tables_of(spots()), 100)
    assert "\n" not in str(caught.value)


def test_cancelling():
    with pytest.raises(Cancelled):
        synthesize_coordinates(tables_of(spots()), 64, progress=lambda *_: False)
