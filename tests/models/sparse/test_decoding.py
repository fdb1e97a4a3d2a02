"""What is coded, and decoding blocks, texels and other directions of it."""

from dataclasses import replace

import numpy as np
import pytest
from small_btf import hemisphere
from trained import PATCH, SHAPE

from addon.errors import NacreError
from addon.models.sparse.interpolation import at_directions, images_at_directions, weights
from addon.models.sparse.patches import overlapping, read_patches, tiling
from addon.models.sparse.transform import Normalisation, normalisation, to_linear_rgb


def test_patches_are_the_normalised_samples(dataset):
    normalised = normalisation(dataset, 0.01)
    origins = tiling(8, 10, PATCH)
    assert origins[:4] == [(0, 0), (0, 4), (0, 8), (4, 0)]
    found = np.concatenate([p for _, p in read_patches(dataset, normalised, PATCH, origins)])
    assert found.shape == (6, 4, 4, 6, 7, 3)
    whole = np.moveaxis(normalised.code(dataset.samples), (0, 1), (2, 3))
    np.testing.assert_array_equal(found[1], whole[0:4, 4:8])
    # A periodic dataset goes on at the other side, another one repeats its last texel.
    np.testing.assert_array_equal(found[5], whole[4:8][:, [8, 9, 0, 1]])
    still = replace(dataset, periodic=False)
    edge = np.concatenate([p for _, p in read_patches(still, normalised, PATCH, origins)])
    np.testing.assert_array_equal(edge[5], whole[4:8][:, [8, 9, 9, 9]])
    assert (6, 8) in overlapping(dataset, PATCH) and (6, 8) not in overlapping(still, PATCH)


@pytest.mark.parametrize("by_deviation", [False, True])
@pytest.mark.parametrize("offset", [1e-5, 0.01, 8.0])
def test_images_are_normalised_and_come_back(dataset, offset, by_deviation):
    normalised = normalisation(dataset, offset, by_deviation)
    values = normalised.code(dataset.samples)
    if by_deviation:
        np.testing.assert_allclose(values.mean((2, 3, 4)), 0.0, atol=1e-4)
        np.testing.assert_allclose(values.std((2, 3, 4)), 1.0, atol=1e-3)
    else:
        np.testing.assert_allclose(values.mean((2, 3)), 0.0, atol=1e-4)
        assert (normalised.deviation == 1.0).all()
    logarithms = normalised.logarithms(values, np.arange(6), np.arange(7))
    back = to_linear_rgb(logarithms, offset)
    np.testing.assert_allclose(back, dataset.samples, rtol=1e-3, atol=1e-4)


def test_a_block_and_a_texel_are_parts_of_the_whole(model):
    whole = model.decode()
    assert whole.shape == SHAPE
    block = model.decode(light=slice(1, 5, 2), view=[6, 0], y=slice(3, 7), x=slice(2, None))
    np.testing.assert_allclose(block, whole[1:5:2][:, [6, 0], 3:7, 2:], rtol=1e-4, atol=1e-5)
    for light, view, y, x in [(0, 0, 0, 0), (5, 6, 7, 9), (2, 3, 4, 5)]:
        texel = model.texel(light, view, y, x)
        np.testing.assert_allclose(texel, whole[light, view, y, x], rtol=1e-3, atol=1e-5)


def _plain(lights, views):
    """No means, and nothing to multiply with."""
    mean = np.zeros((lights, views, 3), np.float32)
    return Normalisation(mean, np.ones((lights, views), np.float32), 1.0)


@pytest.mark.parametrize("kernel", ["linear", "gaussian"])
def test_mixing_coefficients_is_mixing_images(model, kernel):
    """Eq. 6, against the four and more reconstructions that it saves."""
    lights, views = hemisphere(9)[[2, 5]], hemisphere(11)[[3, 4, 8]]
    mixed = at_directions(model, lights, views, kernel)
    # Normalised logarithms of the measured directions, and these mixed.
    plain = replace(model, normalised=_plain(6, 7))
    logarithms = plain.logarithms()
    by_light = weights(model.ensemble.light, lights, kernel)
    by_view = weights(model.ensemble.view, views, kernel)
    expected = np.einsum("al,bv,lvyxc->abyxc", by_light, by_view, logarithms)
    mixed_plain = replace(mixed, normalised=_plain(2, 3))
    np.testing.assert_allclose(mixed_plain.logarithms(), expected, atol=1e-4)
    assert mixed.shape == (2, 3, 8, 10, 3)
    np.testing.assert_allclose(
        mixed.texel(1, 2, 3, 4), mixed.decode()[1, 2, 3, 4], rtol=1e-3, atol=1e-5
    )


@pytest.mark.parametrize("kernel", ["linear", "gaussian"])
def test_images_are_mixed_of_decoded_neighbours(model, kernel):
    lights, views = hemisphere(9)[[2, 5]], hemisphere(11)[[3, 4, 8]]
    mixed = images_at_directions(model, lights, views, kernel)
    expected = np.einsum(
        "al,bv,lvyxc->abyxc",
        weights(model.ensemble.light, lights, kernel),
        weights(model.ensemble.view, views, kernel),
        model.decode(),
    )
    np.testing.assert_allclose(mixed.decode(), expected, rtol=1e-3, atol=1e-5)
    block = mixed.decode(light=[1], view=slice(1, 3), y=slice(3, 7), x=[9, 0])
    np.testing.assert_allclose(block, expected[[1], 1:3, 3:7][..., [9, 0], :], rtol=1e-3, atol=1e-5)
    # At measured directions both are what was measured.
    own = images_at_directions(model, model.ensemble.light, model.ensemble.view)
    np.testing.assert_allclose(own.decode(), model.decode(), rtol=1e-4, atol=1e-6)
    # Coefficients are mixed in logarithms, which is another thing between them.
    of_coefficients = at_directions(model, lights, views, kernel).decode()
    assert 0 < np.abs(of_coefficients - expected).mean() < 0.3 * expected.mean()


def test_weights_are_of_neighbours():
    measured = hemisphere(40)
    rng = np.random.default_rng(0)
    wanted = rng.normal(size=(60, 3))
    wanted[:, 2] = np.abs(wanted[:, 2]) + 0.3
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    for kernel in ("linear", "gaussian"):
        found = weights(measured, wanted, kernel)
        np.testing.assert_allclose(found.sum(1), 1.0, atol=1e-5)
        assert (found >= 0).all()
        # The nearest direction has the largest share, or nearly so.
        angles = np.degrees(np.arccos(np.clip(measured @ wanted.T, -1, 1))).T
        assert (angles[found > 0] < 60).all()
    linear = weights(measured, wanted, "linear")
    assert ((linear > 0).sum(1) <= 3).all()
    np.testing.assert_array_equal(weights(measured, measured, "linear"), np.eye(40))
    inside = wanted[:, 2] > 0.5
    mixed = linear[inside] @ measured
    mixed /= np.linalg.norm(mixed, axis=1, keepdims=True)
    assert np.degrees(np.arccos(np.sum(mixed * wanted[inside], 1).min())) < 3
    with pytest.raises(NacreError):
        weights(measured, measured, "cubic")
