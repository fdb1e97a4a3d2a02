"""Masks to signed distances and back, against all pairs of texels and against scipy."""

import numpy as np
import pytest
from fibres import fibre_masks, views, write_occlusion
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from addon.datasets.occlusion import (
    REACH,
    is_covered,
    signed_distance,
    visibility,
    with_value,
)


def dense_distance(mask, periodic):
    """Signed distances in texels of one mask, from every texel to every other one."""
    places = np.argwhere(np.ones_like(mask))
    offset = np.abs(places[:, None] - places[None])
    if periodic:
        offset = np.minimum(offset, mask.shape - offset)
    apart = np.sqrt((offset**2).sum(-1))
    other = mask.reshape(-1, 1) != mask.reshape(1, -1)
    nearest = np.where(other, apart, np.inf).min(1).reshape(mask.shape)
    return np.where(mask, 1, -1) * nearest


MASKS = hnp.arrays(bool, st.tuples(*[st.integers(1, 3)], *[st.integers(1, 7)] * 2))


@settings(max_examples=150, deadline=None, derandomize=True)
@given(MASKS, st.booleans(), st.sampled_from([1.0, 2.5, REACH, 4.0, np.inf]))
def test_distances_are_those_of_all_pairs(masks, periodic, reach):
    found = signed_distance(masks, periodic, reach)
    assert found.dtype == np.float32
    expected = np.stack([dense_distance(mask, periodic) for mask in masks])
    if np.isinf(reach):
        reach = np.abs(expected[np.isfinite(expected)]).max(initial=0.0) or 1.0
        assert np.abs(found).max() == 1.0
    np.testing.assert_allclose(found, np.clip(expected / reach, -1, 1), rtol=1e-6)


@pytest.mark.parametrize("shape", [(24, 24), (17, 40)])
def test_distances_are_scipys(shape):
    scipy = pytest.importorskip("scipy.ndimage", reason="scipy is not installed")
    rng = np.random.default_rng(3)
    mask = scipy.gaussian_filter(rng.normal(size=shape), 2.0, mode="wrap") > 0.02
    tiled = np.tile(mask, (3, 3))
    inside, outside = (scipy.distance_transform_edt(m) for m in (tiled, ~tiled))
    expected = (inside - outside)[shape[0] : 2 * shape[0], shape[1] : 2 * shape[1]]
    found = signed_distance(mask[None], True, np.inf)[0]
    np.testing.assert_allclose(found, expected / np.abs(expected).max(), rtol=1e-6)
    alone = scipy.distance_transform_edt(mask) - scipy.distance_transform_edt(~mask)
    found = signed_distance(mask[None], False, np.inf)[0]
    np.testing.assert_allclose(found, alone / np.abs(alone).max(), rtol=1e-6)
    cut = np.clip(expected, -REACH, REACH) / REACH
    np.testing.assert_allclose(signed_distance(mask[None], True)[0], cut, rtol=1e-6)


def test_a_straight_edge_by_hand():
    mask = np.array([[[0, 0, 0, 1, 1, 1, 1, 1]]])
    np.testing.assert_allclose(
        signed_distance(mask, False, np.inf)[0, 0], np.array([-3, -2, -1, 1, 2, 3, 4, 5]) / 5
    )
    np.testing.assert_allclose(
        signed_distance(mask, True, np.inf)[0, 0], np.array([-1, -2, -1, 1, 2, 3, 2, 1]) / 3
    )
    np.testing.assert_allclose(
        signed_distance(mask, False, 2.0)[0, 0], np.array([-2, -2, -1, 1, 2, 2, 2, 2]) / 2
    )


def test_the_largest_distance_of_all_views_is_1():
    masks = np.zeros((2, 1, 12))
    masks[0, 0, :2], masks[1, 0, :6] = 1, 1
    distances = signed_distance(masks, True, np.inf)
    assert distances[0].min() == -1.0
    assert distances[1].min() == pytest.approx(-3 / 5)


@pytest.mark.parametrize("reach", [REACH, np.inf])
def test_a_view_without_a_boundary_is_as_far_as_can_be(reach):
    masks = np.array([np.ones((4, 4)), np.zeros((4, 4)), np.eye(4)])
    distances = signed_distance(masks, True, reach)
    assert (distances[0] == 1.0).all()
    assert (distances[1] == -1.0).all()
    assert set(np.sign(distances[2]).ravel()) == {-1.0, 1.0}
    assert (signed_distance(masks[:1], True, reach) == 1.0).all()


@settings(max_examples=50, deadline=None, derandomize=True)
@given(MASKS, st.integers(-9, 9), st.integers(-9, 9))
def test_a_periodic_patch_may_begin_anywhere(masks, down, across):
    moved = signed_distance(np.roll(masks, (down, across), (1, 2)), True)
    np.testing.assert_array_equal(
        moved, np.roll(signed_distance(masks, True), (down, across), (1, 2))
    )


@settings(max_examples=50, deadline=None, derandomize=True)
@given(MASKS, st.booleans())
def test_holes_are_the_negative_of_what_is_covered(masks, periodic):
    np.testing.assert_array_equal(
        signed_distance(~masks, periodic), -signed_distance(masks, periodic)
    )
    np.testing.assert_array_equal(
        is_covered(signed_distance(masks, periodic), "signed-distance"), masks
    )


def test_visibility_is_equation_26():
    distances = np.array([-1.0, -0.01, 0.0, 0.01, 0.04, 0.05, 0.3, 1.0])
    np.testing.assert_allclose(
        visibility(distances, "signed-distance"), [0, 0, 0, 0.12, 0.48, 1, 1, 1]
    )
    masks = np.array([-0.2, 0.0, 0.2, 0.49, 0.5, 0.7, 1.3])
    np.testing.assert_allclose(visibility(masks, "mask"), [0, 0, 0.2, 0.49, 1, 1, 1])


def test_what_is_visible_is_covered():
    values = np.linspace(-1.5, 1.5, 61)
    np.testing.assert_array_equal(
        is_covered(values, "signed-distance"), visibility(values, "signed-distance") > 0
    )
    np.testing.assert_array_equal(is_covered(values, "mask"), visibility(values, "mask") == 1)


def test_a_dataset_turns_into_distances_and_back(tmp_path):
    masks = fibre_masks(views(), 24)
    dataset = write_occlusion(tmp_path / "a.nacre", masks)
    assert with_value(dataset, "mask") is dataset
    distances = with_value(dataset, "signed-distance")
    assert distances.value == "signed-distance"
    np.testing.assert_array_equal(distances.samples, signed_distance(masks, True))
    assert len(distances.source["conversions"]) == 1
    assert dataset.source["conversions"] == []
    back = with_value(distances, "mask")
    assert back.value == "mask"
    np.testing.assert_array_equal(back.samples, masks)
    np.testing.assert_array_equal(back.view, dataset.view)


def test_distances_wrap_only_where_the_patch_does(tmp_path):
    masks = np.zeros((1, 6, 6))
    masks[0, 0] = 1
    found = {}
    for periodic in (True, False):
        dataset = write_occlusion(tmp_path / "a.nacre", masks, periodic=periodic)
        found[periodic] = with_value(dataset, "signed-distance").samples[0, :, 0]
    np.testing.assert_allclose(found[True], np.array([1, -1, -2, -2, -2, -1]) / 2)
    np.testing.assert_allclose(found[False], np.array([1, -1, -2, -2, -2, -2]) / 2)
