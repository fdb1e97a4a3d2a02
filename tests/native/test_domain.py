"""Samples fitted as log luminance with chroma, converted while they are read."""

import nacre_native
import numpy as np
import pytest
from small_btf import hemisphere, make_samples

from addon.models.domain import to_log

RANKS = (6, 3, 4, 4)
SAMPLES = np.maximum(make_samples((6, 24, 8, 7, 3)) - 0.1, 0.0)  # dark parts too, and zeros
CLUSTERS = {
    "clusters": {1: 4},
    "mixtures": {1: 2},
    "global_modes": (0,),
    "directions": {1: hemisphere(24)},
}
FITS = {
    "nsvd": lambda samples, **more: nacre_native.fit_nsvd(samples, RANKS, **more),
    "kcta": lambda samples, **more: nacre_native.fit_clustered(samples, RANKS, **CLUSTERS, **more),
}
EACH = pytest.mark.parametrize("fit", FITS.values(), ids=FITS)


@EACH
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_the_fit_is_one_of_converted_samples(fit, dtype):
    samples = SAMPLES.astype(dtype)
    seen, expected = fit(samples, domain="log"), fit(to_log(samples.astype(np.float32)))
    assert seen["squared_norm"] == pytest.approx(expected["squared_norm"], rel=1e-5)
    np.testing.assert_allclose(seen["errors"][-1], expected["errors"][-1], rtol=1e-3)
    plain = fit(samples)
    assert plain["squared_norm"] == pytest.approx(np.sum(samples.astype(float) ** 2), rel=1e-5)


@EACH
def test_threads_give_the_same_bits(fit):
    one, two = (fit(SAMPLES, domain="log", threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one["core"], two["core"])


@EACH
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_named(fit, value):
    samples = SAMPLES.copy()
    samples[2, 3, 4, 5, 1] = value
    with pytest.raises(ValueError, match="at light 2, view 3, y 4, x 5, channel 1"):
        fit(samples, domain="log")


@EACH
def test_other_domains_and_channels_are_refused(fit):
    with pytest.raises(ValueError, match="^domain: expected linear or log, got lab$"):
        fit(SAMPLES, domain="lab")
    with pytest.raises(ValueError, match="^domain: expected 3 channels, .* got 2$"):
        fit(np.ascontiguousarray(SAMPLES[..., :2]), domain="log")
