import numpy as np
import pytest
from small_btf import hemisphere

from addon.datasets.directions import spherical_to_unit
from addon.models.interpolation import horizon_fade, raise_to_lowest, thin_plate_weights
from addon.tables.parabolic import texel_directions

UP = np.array([[0.0, 0.0, 1.0]])
WANTED = texel_directions(16).reshape(-1, 3)


def rings(*thetas, around=8):
    phi = np.arange(around) * 360.0 / around
    directions = [spherical_to_unit(np.full(around, theta), phi) for theta in thetas]
    return np.concatenate([UP, *directions])


MEASURED = {
    "one": spherical_to_unit([30.0], [70.0]),
    "two": spherical_to_unit([0.0, 50.0], [0.0, 10.0]),
    "three": spherical_to_unit([0.0, 50.0, 50.0], [0.0, 10.0, 100.0]),
    "on a meridian": spherical_to_unit(np.linspace(-75, 75, 11), np.zeros(11)),
    "on a ring": rings(60.0)[1:],
    "at the horizon": spherical_to_unit(np.full(6, 90.0), np.arange(6) * 60.0),
    "on rings": rings(15.0, 30.0, 45.0, 60.0, 75.0),
    "anywhere": hemisphere(81),
}
EACH = pytest.mark.parametrize("measured", MEASURED.values(), ids=MEASURED)
# Of directions in a plane that holds the centre, and of fewer than four, more than one linear
# function goes through the data.
SPREAD = pytest.mark.parametrize(
    "measured", [MEASURED[name] for name in ("on rings", "anywhere")], ids=["on rings", "anywhere"]
)


def inside(measured):
    """Wanted directions no lower than the lowest measured one."""
    return WANTED[WANTED[:, 2] >= measured[:, 2].min()]


@EACH
def test_weights_add_up_to_1(measured):
    np.testing.assert_allclose(thin_plate_weights(measured, WANTED).sum(1), 1.0, atol=1e-9)


@EACH
def test_measured_directions_keep_their_data(measured):
    weights = thin_plate_weights(measured, measured)
    np.testing.assert_allclose(weights, np.eye(len(measured)), atol=1e-7)


@EACH
def test_weights_stay_small(measured):
    """An ill-posed system would give weights of thousands."""
    weights = thin_plate_weights(measured, WANTED)
    assert np.isfinite(weights).all()
    assert np.abs(weights).sum(1).max() < 6.0


@SPREAD
def test_linear_functions_are_reproduced(measured):
    wanted = inside(measured)
    weights = thin_plate_weights(measured, wanted)
    np.testing.assert_allclose(weights @ measured, wanted, atol=1e-9)


def test_a_ring_is_interpolated_along_it():
    """Data in the plane of the ring is linear there."""
    measured = MEASURED["on a ring"]
    between = spherical_to_unit([60.0, 60.0], [22.5, 100.0])
    np.testing.assert_allclose(thin_plate_weights(measured, between) @ measured, between, atol=1e-9)


@SPREAD
def test_a_smooth_function_is_followed(measured):
    def smooth(d):
        return np.exp(-2.0 * (d[:, 0] - 0.3) ** 2 - d[:, 1] ** 2)

    wanted = inside(measured)
    error = np.abs(thin_plate_weights(measured, wanted) @ smooth(measured) - smooth(wanted))
    assert error.max() < 0.05
    assert error.mean() < 0.01


@EACH
def test_lower_directions_take_the_lowest_elevation(measured):
    low = spherical_to_unit([90.0, 90.0, 89.0], [20.0, 200.0, 77.0])
    raised = raise_to_lowest(measured, low)
    np.testing.assert_allclose(np.linalg.norm(raised, axis=1), 1.0)
    np.testing.assert_allclose(raised[:, 2], np.maximum(low[:, 2], measured[:, 2].min()))
    for before, after in zip(low, raised, strict=True):  # the azimuth is kept
        assert abs(before[0] * after[1] - before[1] * after[0]) < 1e-12
        assert before[:2] @ after[:2] >= 0.0
    np.testing.assert_allclose(
        thin_plate_weights(measured, low), thin_plate_weights(measured, raised), atol=1e-12
    )


def test_higher_directions_stay():
    measured = MEASURED["on rings"]
    high = inside(measured)
    np.testing.assert_allclose(raise_to_lowest(measured, high), high, atol=1e-12)
    np.testing.assert_allclose(raise_to_lowest(measured, UP), UP)


def test_light_fades_with_its_cosine_below_the_lowest():
    measured = MEASURED["on rings"]  # down to 75 degrees
    theta = np.array([0.0, 60.0, 75.0, 80.0, 85.0, 90.0, 95.0])
    fade = horizon_fade(measured, spherical_to_unit(theta, np.zeros(7)))
    expected = np.cos(np.radians(theta)) / np.cos(np.radians(75.0))
    np.testing.assert_allclose(fade, np.clip(expected, 0.0, 1.0), atol=1e-12)


def test_light_measured_at_the_horizon_does_not_fade():
    fade = horizon_fade(MEASURED["at the horizon"], spherical_to_unit([0.0, 89.0], [0.0, 0.0]))
    np.testing.assert_array_equal(fade, 1.0)
