"""Decoding against the sum over clusters written out with dense, mostly zero bases."""

import numpy as np
import pytest
from dense_model import dense
from hypothesis import given, settings
from hypothesis import strategies as st
from small_btf import make_model

from addon.models.clustered_tucker import MODES

NSVD = {}
KCTA = {"clusters": {"view": 3}, "mixtures": {"view": 2}, "shared": ("light",)}
MKCTA = {
    "clusters": {"light": 2, "view": 3},
    "mixtures": {"light": 2, "view": 2},
    "shared": ("y", "x"),
}
EVERY = {
    "clusters": {"light": 2, "view": 3, "y": 2, "x": 2},
    "mixtures": {"view": 2, "x": 2},
}
KINDS = pytest.mark.parametrize("kind", [NSVD, KCTA, MKCTA, EVERY], ids=str)


@KINDS
def test_the_whole_is_the_sum_over_clusters(kind):
    model = make_model(**kind)
    decoded = model.decode()
    assert decoded.shape == model.shape == (3, 4, 5, 6, 2)
    assert decoded.dtype == np.float32
    assert decoded.flags.c_contiguous
    np.testing.assert_allclose(decoded, dense(model), rtol=1e-4, atol=1e-4)


@KINDS
@pytest.mark.parametrize(
    "block",
    [
        {"light": [2]},
        {"view": slice(1, 3), "y": slice(4, None)},
        {"light": slice(1, 3), "view": [3, 0], "y": [2], "x": slice(None, None, 2)},
        {"view": slice(2, 2)},
    ],
    ids=str,
)
def test_a_block_is_a_part_of_the_whole(kind, block):
    model = make_model(**kind)
    expected = model.decode()
    for axis, mode in enumerate(MODES):
        expected = np.moveaxis(
            np.moveaxis(expected, axis, 0)[block.get(mode, slice(None))], 0, axis
        )
    decoded = model.decode(**block)
    assert decoded.shape == expected.shape
    np.testing.assert_allclose(decoded, expected, rtol=1e-4, atol=1e-4)


@st.composite
def models(draw):
    size = st.integers(1, 4)
    shape = tuple(draw(size) for _ in MODES) + (draw(st.sampled_from([1, 3])),)
    ranks = tuple(draw(st.integers(1, 3)) for _ in MODES)
    chosen = [mode for mode in MODES if draw(st.booleans())]
    clusters = {mode: draw(st.integers(1, 3)) for mode in chosen}
    mixtures = {mode: draw(st.integers(1, count)) for mode, count in clusters.items()}
    shared = tuple(mode for mode in MODES if draw(st.booleans()))
    return make_model(shape, ranks, clusters, mixtures, shared, draw(st.integers(0, 99)))


@settings(max_examples=100, deadline=None, derandomize=True)
@given(models())
def test_any_shape_ranks_and_clusters(model):
    np.testing.assert_allclose(model.decode(), dense(model), rtol=1e-3, atol=1e-3)


def test_what_a_model_says_of_itself():
    model = make_model(**MKCTA)
    assert model.ranks == {"light": 3, "view": 2, "y": 2, "x": 3}
    assert model.mixtures == {"light": 2, "view": 2}
    assert model.channels == 2
    assert make_model().mixtures == {}
