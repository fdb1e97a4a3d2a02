"""Single texels against the decoder, which reconstructs whole blocks."""

from dataclasses import replace
from math import prod

import nacre_native
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_btf import make_model

from addon.models.clustered_tucker import MODES

KINDS = {
    "nsvd": {"ranks": (5, 6, 3, 4)},
    "cta": {"ranks": (4, 2, 3, 3), "clusters": {"view": 3}, "shared": ("light",)},
    "kcta": {
        "ranks": (5, 3, 2, 3),
        "clusters": {"view": 4},
        "mixtures": {"view": 3},
        "shared": ("light",),
    },
    "kcta of the light": {
        "ranks": (2, 5, 3, 2),
        "clusters": {"light": 3},
        "mixtures": {"light": 2},
    },
    "mkcta": {
        "ranks": (4, 4, 3, 2),
        "clusters": {"light": 4, "view": 5},
        "mixtures": {"light": 3, "view": 2},
        "shared": ("y", "x"),
    },
    "mkcta of all modes": {
        "ranks": (2, 3, 2, 2),
        "clusters": {"light": 2, "view": 3, "y": 3, "x": 2},
        "mixtures": {"light": 2, "y": 2, "x": 2},
    },
}
EACH = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
SHAPE = (6, 7, 5, 9, 3)


def coloured(model, channels):
    """The same with as many channels as a material of any colours has."""
    return replace(model, dataset={**model.dataset, "channels": [*"ABCDEFG"[:channels]]})


def evaluator_of(model, **changes):
    number = {mode: n for n, mode in enumerate(MODES)}
    arguments = {
        "core": model.core,
        "basis": [model.bases[mode] for mode in MODES],
        "members": {number[mode]: members for mode, members in model.members.items()},
        "clusters": {number[mode]: count for mode, count in model.clusters.items()},
        "channels": model.channels,
    }
    return nacre_native.Evaluator(**arguments | changes)


def close(seen, expected):
    scale = max(1.0, np.abs(expected).max(initial=0.0))
    np.testing.assert_allclose(seen, expected, rtol=1e-4, atol=1e-5 * scale)


@EACH
@pytest.mark.parametrize("channels", [1, 2, 3, 4, 7])
def test_every_texel_is_the_decoders(kind, channels):
    model = coloured(make_model((*SHAPE[:4], channels), **kind), channels)
    evaluator = evaluator_of(model)
    assert evaluator.shape == model.shape
    expected = model.decode().reshape(*SHAPE[:2], -1, channels)
    texels = np.random.default_rng(0).permutation(SHAPE[2] * SHAPE[3])
    for light, view in ((0, 0), (5, 3), (2, 6)):
        values = evaluator.decode_texels(light, view, texels)
        assert values.dtype == np.float32
        close(values, expected[light, view][texels])


@EACH
def test_pairs_of_light_and_view_come_together(kind):
    model = make_model(SHAPE, **kind)
    evaluator = evaluator_of(model)
    expected = model.decode().reshape(*SHAPE[:2], -1, 3)
    rng = np.random.default_rng(1)
    light, view = rng.integers(0, SHAPE[0], 50), rng.integers(0, SHAPE[1], 50)
    shared, own = rng.integers(0, 45, 13), rng.integers(0, 45, (50, 13))
    close(evaluator.decode_texels(light, view, shared), expected[light, view][:, shared])
    seen = evaluator.decode_texels(light, view, own)
    assert seen.shape == (50, 13, 3)
    close(seen, expected[light[:, None], view[:, None], own])


@EACH
def test_only_the_values_of_the_mixture_clusters_are_read(kind):
    """A core value of any other cluster may be anything, even NaN."""
    model = make_model(SHAPE, **kind)
    evaluator = evaluator_of(model)
    mixtures = prod(model.mixtures.values())
    assert evaluator.reads == mixtures * model.ranks["light"] * model.ranks["view"]
    light, view = 1, 2
    texel = 4 * SHAPE[3] + 7
    place = {"light": light, "view": view, "y": 4, "x": 7}
    used = [model.members[mode][place[mode]] for mode in model.clusters]
    unused = np.ones([*model.clusters.values(), 1], bool)
    unused[np.ix_(*used)] = False
    core = model.core.copy()
    core[unused.ravel()] = np.nan
    assert np.isnan(core).any() == bool(model.clusters)
    np.testing.assert_array_equal(
        evaluator_of(model, core=core).decode_texels(light, view, [texel]),
        evaluator.decode_texels(light, view, [texel]),
    )


@EACH
def test_any_number_of_texels_and_threads_gives_the_same_bits(kind):
    model = make_model(SHAPE, **kind)
    evaluator = evaluator_of(model)
    texels = np.random.default_rng(2).integers(0, 45, 20_003)
    one = evaluator.decode_texels(3, 4, texels, threads=1)
    np.testing.assert_array_equal(evaluator.decode_texels(3, 4, texels, threads=3), one)
    np.testing.assert_array_equal(evaluator_of(model, threads=1).decode_texels(3, 4, texels), one)
    for count in (0, 1, 2, 3, 5, 8, 13):  # summed in groups, so only nearly the same
        seen = evaluator.decode_texels(3, 4, texels[:count])
        assert seen.shape == (count, 3)
        close(seen, one[:count])


@st.composite
def models(draw):
    size = st.integers(1, 4)
    shape = tuple(draw(size) for _ in MODES) + (draw(st.integers(1, 5)),)
    ranks = tuple(draw(st.integers(1, 5)) for _ in MODES)
    chosen = [mode for mode in MODES if draw(st.booleans())]
    clusters = {mode: draw(st.integers(1, 3)) for mode in chosen}
    mixtures = {mode: draw(st.integers(1, count)) for mode, count in clusters.items()}
    shared = tuple(mode for mode in MODES if draw(st.booleans()))
    model = make_model(shape, ranks, clusters, mixtures, shared, draw(st.integers(0, 99)))
    return coloured(model, shape[4])


@settings(max_examples=60, deadline=None, derandomize=True)
@given(models())
def test_any_shape_ranks_and_clusters(model):
    lights, views, height, width, channels = model.shape
    light, view = np.indices((lights, views)).reshape(2, -1)
    seen = evaluator_of(model).decode_texels(light, view, np.arange(height * width))
    expected = model.decode().reshape(lights * views, height * width, channels)
    np.testing.assert_allclose(seen, expected, rtol=1e-3, atol=1e-3)


def message(call):
    with pytest.raises(ValueError) as error:
        call()
    text = str(error.value)
    assert "\n" not in text
    return text


def test_wrong_models_are_named():
    model = make_model(SHAPE, **KINDS["mkcta"])
    bases = [model.bases[mode] for mode in MODES]
    light, view = model.members.values()
    for changes, expected in (
        ({"core": model.core[:-1]}, "core: expected 20 clusters, got 19"),
        ({"core": model.core[0]}, "core: expected 5 dimensions, got 4"),
        ({"basis": bases[:3]}, "basis: expected 4 arrays, got 3"),
        ({"basis": [bases[0][:3], *bases[1:]]}, "basis: expected 1 or 5 owners of the light basis"),
        ({"basis": [bases[0][..., :3], *bases[1:]]}, "basis: expected rank 4 for mode 0"),
        ({"clusters": {0: 4}}, "members: expected clustered modes only"),
        ({"members": {0: light}}, "members: expected those of the clustered mode 1"),
        ({"members": {0: light, 1: view[:3]}}, "members: expected (7, 2) for mode 1, got (3, 2)"),
        ({"members": {0: light, 1: view + 3}}, "members: expected clusters below 5, got"),
        ({"members": {0: light, 1: view * 0}}, "members: expected distinct clusters, got 0 twice"),
        ({"channels": 5}, "channels: expected a divisor of the 18 light rows, got 5"),
        ({"channels": 0}, "channels: expected 1 or more, got 0"),
    ):
        assert message(lambda changes=changes: evaluator_of(model, **changes)).startswith(expected)
    unclustered = make_model(SHAPE, **KINDS["nsvd"])
    bases = [np.repeat(unclustered.bases[mode], 2, 2) for mode in MODES]
    text = message(lambda: evaluator_of(unclustered, basis=bases))
    assert text == "basis: expected 1 mixture for mode 0, which is not clustered, got 2"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ((6, 0, [0]), "light: expected 0 to 5, got 6"),
        ((0, -1, [0]), "view: expected 0 to 6, got -1"),
        ((0, 0, [45]), "texels: expected 0 to 44, got 45"),
        ((0, 0, [0.5]), "texels: expected whole numbers"),
        ((0, 0, 3), "texels: expected a list"),
        (([0, 1], [0], [0]), "view: expected as many as lights, 2, got 1"),
        (([0, 1], [0, 1], [[0]]), "texels: expected one list, or one for each of 2 pairs"),
        ((0, 0, [[0]]), "texels: expected one list, or one for each of 1 pairs"),
    ],
)
def test_wrong_arguments_are_named(arguments, expected):
    evaluator = evaluator_of(make_model(SHAPE, **KINDS["nsvd"]))
    assert message(lambda: evaluator.decode_texels(*arguments)).startswith(expected)
