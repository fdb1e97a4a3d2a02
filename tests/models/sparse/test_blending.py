"""Blends of sparse models: the sum of their logarithms, and one model of it."""

from dataclasses import replace
from math import prod

import numpy as np
import pytest
from small_btf import hemisphere, make_samples, write_dataset

from addon.errors import Cancelled, NacreError
from addon.models.clustered_tucker import expand
from addon.models.sparse import blending
from addon.models.sparse.blending import bake, blend
from addon.models.sparse.coding import code
from addon.models.sparse.files import load_sparse, save_sparse
from addon.models.sparse.training import train
from addon.models.sparse.transform import OFFSET, Normalisation, to_linear_rgb, to_log_yuv

SHAPE = (6, 7, 8, 10, 3)  # patches of 4 x 4 reach over the edge along x
FEW = {"Y": 60, "U": 12, "V": 12}
EVERY = {key: 16 * 42 for key in "YUV"}


@pytest.fixture(scope="module")
def datasets(tmp_path_factory):
    folder = tmp_path_factory.mktemp("blending")
    return [
        write_dataset(folder / "a.nacre", SHAPE, make_samples(SHAPE, 1)),
        write_dataset(folder / "b.nacre", SHAPE, 0.3 * make_samples(SHAPE, 2) ** 2),
    ]


@pytest.fixture(scope="module")
def ensembles(datasets):
    settings = {"patch": (4, 4), "dictionaries": 2, "sweeps": 3, "sparsity": FEW}
    return [train([dataset], **settings) for dataset in datasets]


@pytest.fixture(scope="module")
def models(datasets, ensembles):
    """Two materials in an ensemble of their own each, and divided by deviations of their own."""
    rng = np.random.default_rng(5)
    found = [code(d, e, FEW) for d, e in zip(datasets, ensembles, strict=True)]
    deviations = rng.uniform(0.5, 2.0, (2, *SHAPE[:2])).astype(np.float32)
    return [
        replace(model, normalised=replace(model.normalised, deviation=own))
        for model, own in zip(found, deviations, strict=True)
    ]


@pytest.fixture(scope="module")
def mask():
    return np.random.default_rng(0).random(SHAPE[2:4], np.float32)


def dense(models, weights, offset=OFFSET):
    """Decoded samples of the models, mixed as logarithms."""
    weights = [np.broadcast_to(own, SHAPE[2:4])[..., None] for own in weights]
    mixed = sum(
        np.log(model.decode() + offset) * own for model, own in zip(models, weights, strict=True)
    )
    return np.exp(mixed) - offset


def test_the_sum_of_sparse_sums_is_the_mix_of_the_decoded_logarithms(models, mask):
    for share in (0.25, mask):
        mix = blend(models, [1 - share, share])
        expected = dense(models, [1 - share, share])
        np.testing.assert_allclose(mix.decode(), expected, rtol=1e-3, atol=1e-5)
        block = mix.decode(light=[4, 1], view=slice(2, 5), y=slice(3, 7), x=[9, 0])
        np.testing.assert_allclose(
            block, expected[[4, 1]][:, 2:5, 3:7, [9, 0]], rtol=1e-3, atol=1e-5
        )
        texel = mix.texel(2, 3, 4, 5)
        np.testing.assert_allclose(texel, expected[2, 3, 4, 5], rtol=1e-3, atol=1e-5)


def test_of_three_and_beyond_the_materials(models):
    three = [*models, models[0].truncated(8)]
    weights = [0.2, 0.9, -0.1]
    np.testing.assert_allclose(
        blend(three, weights).decode(), dense(three, weights), rtol=2e-3, atol=1e-5
    )


def test_black_stays_black(models):
    """Mixed is RGB + offset: where both are black, so is the blend."""
    black = np.full((1, 3), 0.0, np.float32)
    mixed = 0.5 * to_log_yuv(black, 0.01) + 0.5 * to_log_yuv(black, 0.01)
    np.testing.assert_allclose(to_linear_rgb(mixed, 0.01), 0.0, atol=1e-7)
    # Halfway to white is the geometric mean.
    mixed = 0.5 * to_log_yuv(black, 0.01) + 0.5 * to_log_yuv(black + 0.99, 0.01)
    np.testing.assert_allclose(to_linear_rgb(mixed, 0.01), 0.09, atol=1e-5)


def test_all_coefficients_of_a_baked_blend_are_the_blend(models, mask):
    """In another dictionary, with deviations that differ from image to image, and by a mask."""
    for share in (0.25, mask):
        mix = blend(models, [1 - share, share])
        baked = bake(mix, EVERY)
        # What is left is values' rounding to one byte.
        assert baked.fit["lost"] < 1e-6 and baked.fit["snr_db"] > 35


def test_where_deviations_are_alike_baking_is_equations_8_and_9(models):
    """With R = U(k)^T U(p) of each mode, written out."""
    ones = np.ones(SHAPE[:2], np.float32)
    none = np.zeros((*SHAPE[:2], 3), np.float32)
    plain = [replace(m, normalised=Normalisation(none, ones, 0.01)) for m in models]
    share = 0.3
    baked = bake(blend(plain, [1 - share, share]), EVERY)
    for key, codes in baked.codes.items():
        a, b = (model.codes[key] for model in plain)
        for patch in range(len(codes.members)):
            # k is one of both ensembles' dictionaries.
            target = [
                matrices[codes.members[patch]] for matrices in baked.ensemble.dictionaries[key]
            ]
            expected = np.zeros(baked.ensemble.shape(key), np.float32)
            for weight, own, model in ((1 - share, a, plain[0]), (share, b, plain[1])):
                u = [m[own.members[patch]] for m in model.ensemble.dictionaries[key]]
                r = [to.T @ of for to, of in zip(target, u, strict=True)]
                expected += weight * expand(tensor(own, patch, expected.shape), r)
            np.testing.assert_allclose(
                tensor(codes, patch, expected.shape), expected,
                rtol=0.036, atol=2e-3 * abs(expected).max(),
            )  # fmt: skip


def tensor(codes, patch, shape):
    found = np.zeros(prod(shape), np.float32)
    np.add.at(found, codes.positions[:, patch], codes.values[:, patch])
    return found.reshape(shape)


def test_a_material_alone_comes_back_as_it_is(models):
    a = models[0]
    baked = bake(blend(models, [1.0, 0.0]))
    assert baked.sparsity == a.sparsity and baked.quality == a.quality
    assert baked.ensemble.dictionaries["Y"][0].shape == (2, 4, 4)  # b's are not needed
    np.testing.assert_allclose(baked.normalised.deviation, a.normalised.deviation, rtol=1e-6)
    np.testing.assert_allclose(baked.decode(), a.decode(), rtol=1e-3, atol=1e-3)


def test_error_falls_with_the_sparsity_and_files_keep_it(models, mask, tmp_path):
    mix = blend(models, [1 - mask, mask])
    found = [bake(mix, {key: n * count for key, count in FEW.items()}) for n in (1, 2, 4)]
    snr = [model.fit["snr_db"] for model in found]
    assert snr == sorted(snr) and snr[-1] > snr[0] + 1
    lost = [model.fit["lost"] for model in found]
    assert lost == sorted(lost, reverse=True) and lost[-1] > 0
    save_sparse(found[1], tmp_path / "m.exr")
    loaded = load_sparse(tmp_path / "m.exr")
    np.testing.assert_allclose(loaded.decode(), found[1].decode(), rtol=0.02, atol=0.02)
    assert loaded.ensemble.dictionaries["Y"][0].shape == (4, 4, 4)
    assert loaded.truncated(4).quality == 4


def test_dictionaries_of_both_are_there_to_choose_from(models, ensembles, monkeypatch):
    """Each patch has the one that loses least, which the first material's alone cannot do."""
    mix = blend(models, [0.3, 0.7])
    both = bake(mix)
    assert {tuple(m.shape[0] for m in u) for u in both.ensemble.dictionaries.values()} == {(4,) * 4}
    assert set(both.codes["Y"].members) > {2} or set(both.codes["Y"].members) > {3}
    monkeypatch.setattr(blending, "_joined", lambda ensembles: ensembles[0])
    assert bake(mix).fit["lost"] > 1.05 * both.fit["lost"]


def test_what_does_not_go_together_is_refused(models, datasets, ensembles, tmp_path):
    a, b = models
    cases = [
        (replace(b, height=4), "texels"),
        (replace(b, ensemble=replace(b.ensemble, patch=(8, 4))), "a patch: 4 x 8, not 4 x 4"),
        (replace(b, normalised=replace(b.normalised, offset=1e-5)), "offset 1e-05"),
        (replace(b, ensemble=replace(b.ensemble, view=hemisphere(9))), "9 views, not for 7"),
    ]
    for other, word in cases:
        with pytest.raises(NacreError) as error:
            blend([a, other], [0.5, 0.5])
        assert "\n" not in str(error.value) and word in str(error.value)
    for weights, word in (
        ([0.5, 0.6], "sum of 1"),
        ([np.nan, 0.5], "sum of 1"),
        ([np.ones((10, 8)), 0.0], "8 x 10 texels and the materials have 10 x 8"),
    ):
        with pytest.raises(NacreError) as error:
            blend(models, weights)
        assert "\n" not in str(error.value) and word in str(error.value)
    with pytest.raises(NacreError) as error:
        bake(blend(models, [0.5, 0.5]), FEW | {"U": 0})
    assert "U=0" in str(error.value)
    with pytest.raises(Cancelled):
        bake(blend(models, [0.5, 0.5]), progress=lambda f, m: f < 0.5)
