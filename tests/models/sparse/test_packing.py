"""Coefficients in few bytes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.models.sparse.model import COEFFICIENT_BYTES, Codes
from addon.models.sparse.packing import pack, unpack


def codes_of(count, patches, size, seed=0):
    rng = np.random.default_rng(seed)
    positions = np.stack([rng.choice(size, count, replace=False) for _ in range(patches)], 1)
    values = rng.standard_normal((count, patches)).astype(np.float32) ** 3
    values[rng.random(values.shape) < 0.1] = 0.0
    positions[values == 0] = 0  # as unused ones are
    members = np.zeros(patches, np.uint32)
    return Codes(positions.astype(np.uint32), values, members).rounded()


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 300), st.integers(1, 4), st.data())
def test_what_is_packed_comes_back(count, patches, data):
    size = data.draw(st.integers(count, 40 * count) | st.integers(count, 2**31))
    if size > 10**6:  # drawing without repetition takes memory
        codes = codes_of(count, patches, 10**6)
        codes.positions[...] = np.minimum(codes.positions.astype(np.int64) * 2000, size - 1)
        codes = codes.rounded()
    else:
        codes = codes_of(count, patches, size)
    words = pack(codes.positions, codes.values, size, codes.largest)
    positions, values = unpack(words, count, size, codes.largest)
    np.testing.assert_array_equal(values, codes.values)
    np.testing.assert_array_equal(positions, codes.positions)


@pytest.mark.parametrize("count", [400, 2133])
def test_they_take_what_is_said(count):
    """Of patches of 10 x 10 texels and the 151 directions, from a level of quality 16 on."""
    codes = codes_of(count, 3, 10 * 10 * 151 * 151)
    words = pack(codes.positions, codes.values, 10 * 10 * 151 * 151, codes.largest)
    assert words.nbytes <= 3 * COEFFICIENT_BYTES * count


def test_what_is_not_packed_is_refused():
    codes = codes_of(20, 2, 1000)
    words = pack(codes.positions, codes.values, 1000, codes.largest)
    for wrong in (words[:, :-1], np.full_like(words, 0), np.full_like(words, 2**32 - 1)):
        with pytest.raises(ValueError):
            unpack(wrong, 20, 1000, 1.0)
    codes.positions[np.argmax(codes.positions[:, 0]), 0] = 999
    words = pack(codes.positions, codes.values, 1000, codes.largest)
    with pytest.raises(ValueError, match="beyond"):
        unpack(words, 20, 999, codes.largest)
