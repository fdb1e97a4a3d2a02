"""Models in new directions against splines of their samples."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from dense_model import dense_basis
from measured import WOOL, compressed
from small_btf import hemisphere, make_model

from addon.datasets.directions import spherical_to_unit
from addon.models.clustered_tucker import MODES
from addon.models.exr import load_model
from addon.models.interpolation import thin_plate_weights
from addon.models.resample import resample, resample_mode

SHAPE = (9, 11, 4, 5, 3)
KINDS = {
    "nsvd": {"ranks": (5, 6, 3, 3)},
    "cta": {"ranks": (3, 2, 3, 3), "clusters": {"view": 3}, "shared": ("light",)},
    "kcta": {
        "ranks": (4, 3, 2, 3),
        "clusters": {"view": 4},
        "mixtures": {"view": 3},
        "shared": ("light",),
    },
    "kcta of local light rows": {
        "ranks": (4, 2, 2, 3),
        "clusters": {"view": 3},
        "mixtures": {"view": 2},
    },
    "kcta of the light": {
        "ranks": (2, 4, 3, 3),
        "clusters": {"light": 3},
        "mixtures": {"light": 2},
        "shared": ("view",),
    },
    "mkcta": {
        "ranks": (2, 3, 3, 3),
        "clusters": {"light": 3, "view": 4},
        "mixtures": {"light": 2, "view": 2},
        "shared": ("y", "x"),
    },
    "mkcta of three": {
        "ranks": (2, 2, 3, 3),
        "clusters": {"light": 4, "view": 4},
        "mixtures": {"light": 3, "view": 3},
        "shared": ("y", "x"),
    },
    "mkcta of one view basis": {
        "ranks": (2, 3, 3, 3),
        "clusters": {"light": 3, "view": 4},
        "mixtures": {"light": 2, "view": 2},
        "shared": ("view", "y", "x"),
    },
    "every mode": {
        "ranks": (2, 3, 2, 2),
        "clusters": {"light": 2, "view": 3, "y": 2, "x": 2},
        "mixtures": {"light": 2, "view": 2, "x": 2},
    },
}
EACH = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)


def measured(model):
    return (np.asarray(model.dataset[mode]) for mode in ("light", "view"))


def between(count, seed):
    """Directions none of which was measured, no lower than the spirals go, which is 80 degrees."""
    rng = np.random.default_rng(seed)
    theta, phi = np.degrees(np.arccos(rng.uniform(0.2, 1.0, count))), rng.uniform(0, 360, count)
    return spherical_to_unit(theta, phi)


def close(seen, expected):
    np.testing.assert_allclose(seen, expected, rtol=1e-3, atol=1e-4 * np.abs(expected).max())


def spline(model, light, view, texels=slice(None)):
    """The samples of a model, interpolated."""
    lights, views = measured(model)
    return np.einsum(
        "al,bv,lvyxc->abyxc",
        thin_plate_weights(lights, light),
        thin_plate_weights(views, view),
        model.decode(y=texels, x=texels).astype(float),
        optimize=True,
    )


@EACH
def test_measured_directions_give_the_model_back(kind):
    model = make_model(SHAPE, **kind)
    same = resample(model, *measured(model))
    np.testing.assert_array_equal(same.core, model.core)
    for mode in MODES:
        np.testing.assert_allclose(same.bases[mode], model.bases[mode], rtol=1e-6, atol=1e-6)
    for mode in model.members:
        np.testing.assert_array_equal(same.members[mode], model.members[mode])
    for mode in ("light", "view"):
        np.testing.assert_allclose(same.dataset[mode], model.dataset[mode])


@EACH
def test_new_directions_are_as_sparse_as_measured_ones(kind):
    model = make_model(SHAPE, **kind)
    light, view = between(6, 0), between(8, 1)
    new = resample(model, light, view)
    assert new.shape == (6, 8, *SHAPE[2:])
    assert new.decode().shape == new.shape
    assert (new.clusters, new.mixtures, new.ranks) == (model.clusters, model.mixtures, model.ranks)
    for mode in MODES:
        assert new.bases[mode].dtype == np.float32
        assert len(new.bases[mode]) == len(model.bases[mode])
    for mode, members in new.members.items():
        assert members.dtype == np.uint32
        assert (np.diff(members.astype(int), axis=1) > 0).all()
        assert members.max() < model.clusters[mode]


@EACH
def test_a_row_depends_on_its_direction_alone(kind):
    model = make_model(SHAPE, **kind)
    directions = np.concatenate([between(5, 2), hemisphere(SHAPE[1])[3:4]])
    for mode in ("light", "view"):
        tied = model.channels if mode == "light" else 1
        whole = resample_mode(model, mode, directions)
        for number in range(len(directions)):
            one = resample_mode(model, mode, directions[number : number + 1])
            rows = slice(tied * number, tied * (number + 1))
            np.testing.assert_allclose(one.basis, whole.basis[:, rows], rtol=1e-6, atol=1e-9)
            if whole.members is not None:
                np.testing.assert_array_equal(one.members[0], whole.members[number])


@EACH
def test_all_clusters_mixed_are_a_spline_of_the_samples(kind):
    """With K = C nothing is lost in the clusters."""
    clusters = {mode: 2 for mode in kind.get("clusters", {})}
    model = make_model((15, 16, 4, 5, 3), **{**kind, "clusters": clusters, "mixtures": clusters})
    light, view = between(6, 3), between(7, 4)
    close(resample(model, light, view).decode(), spline(model, light, view))


@EACH
@pytest.mark.parametrize("mode", ["light", "view"])
def test_rows_are_the_least_squares_in_the_best_clusters(kind, mode):
    """Nothing of those clusters is nearer to the spline, nor the neighbours' clusters; none at all
    where the search is the optimal one."""
    model = make_model(SHAPE, **kind)
    if mode not in model.clusters:
        return
    direction = between(1, 5)
    lights, views = measured(model)
    light, view = (direction, views) if mode == "light" else (lights, direction)
    wanted = spline(model, light, view).ravel()
    seen = np.linalg.norm(resample(model, light, view).decode().ravel() - wanted)
    found = resample_mode(model, mode, direction).members[0]
    near = np.argsort(-(lights if mode == "light" else views) @ direction[0])[:3]
    every = [set(members) for members in combinations(range(model.clusters[mode]), len(found))]
    errors = {frozenset(members): fit_error(model, mode, members, wanted) for members in every}
    rounding = 1e-5 * np.linalg.norm(wanted)
    assert seen == pytest.approx(errors[frozenset(found.tolist())], rel=1e-4, abs=rounding)
    rivals = [frozenset(members.tolist()) for members in model.members[mode][near]]
    assert all(seen <= errors[rival] * (1 + 1e-4) + rounding for rival in rivals)
    if len(model.clusters) > 1 and len(found) == 2:
        assert seen <= min(errors.values()) * (1 + 1e-4) + rounding


def fit_error(model, mode, members, wanted):
    """The distance of `wanted` from the span of some clusters of a mode, all dense."""
    rows = {}
    for number, indices in enumerate(np.ndindex(*model.clusters.values())):
        vector = dict(zip(model.clusters, indices, strict=True))
        if vector[mode] not in members:
            continue
        whole = model.core[number].astype(float)
        for axis, name in enumerate(MODES):
            if name != mode:
                basis = dense_basis(model, name, vector).astype(float)
                whole = np.moveaxis(np.tensordot(basis, whole, (1, axis)), 0, axis)
        whole = np.moveaxis(whole, MODES.index(mode), 0)
        key = vector[mode] if len(model.bases[mode]) == 1 else number
        rows[key] = rows.get(key, 0) + whole.reshape(len(whole), -1)
    span = np.concatenate([*rows.values()]).T
    channels = model.channels
    if mode == "light":  # a column for each colour; samples are (1, view, y, x, channel)
        columns = wanted.reshape(-1, channels)
    else:  # samples are (light, 1, y, x, channel), rows of the light mode channels * light + c
        columns = wanted.reshape(SHAPE[0], -1, channels).swapaxes(1, 2).reshape(-1, 1)
    solution = np.linalg.lstsq(span, columns, rcond=1e-8)[0]
    return np.linalg.norm(span @ solution - columns)


@EACH
def test_directions_below_the_lowest_take_its_elevation(kind):
    model = make_model(SHAPE, **kind)
    low = spherical_to_unit([80.0, 85.0, 90.0], [140.0] * 3)
    lowest, *lower = resample(model, lights=low).decode()
    for values in lower:
        close(values, lowest)
    lowest, *lower = np.moveaxis(resample(model, views=low).decode(), 1, 0)
    for values in lower:
        close(values, lowest)


@EACH
def test_a_mode_may_stay_as_it_is(kind):
    model = make_model(SHAPE, **kind)
    lights, views = measured(model)
    light, view = between(3, 8), between(4, 9)
    for part, whole in (
        (resample(model, lights=light), resample(model, light, views)),
        (resample(model, views=view), resample(model, lights, view)),
        (resample(model), model),
    ):
        assert part.dataset == whole.dataset
        np.testing.assert_array_equal(part.decode(), whole.decode())


def test_one_light_and_one_view_are_enough():
    model = make_model((1, 1, 4, 4, 3), (3, 1, 2, 2))
    up = np.array([[0.0, 0.0, 1.0]])
    close(resample(model, up, up).decode(), model.decode())
    close(resample(model, up, between(1, 0)).decode(), model.decode())


def test_directions_that_were_measured_twice_keep_the_first():
    model = make_model(SHAPE, **KINDS["mkcta"])
    view = hemisphere(SHAPE[1])
    view[4] = view[2]
    model = replace(model, dataset={**model.dataset, "view": view.tolist()})
    lights, _ = measured(model)
    seen = resample(model, lights, view[[4, 2]]).decode()
    np.testing.assert_array_equal(seen[:, 0], seen[:, 1])
    close(seen[:, 1], model.decode(view=[2])[:, 0])


@pytest.mark.parametrize(("setting", "least_db"), [("nsvd", 100.0), ("k3", 20.0), ("k1", 12.0)])
def test_on_real_data_it_is_near_the_spline(setting, least_db, tmp_path_factory):
    """What few clusters cost beside interpolating the decoded samples themselves."""
    model = load_model(compressed(WOOL, setting, tmp_path_factory))
    lights, views = measured(model)
    light, view, some = between(5, 6), between(9, 7), slice(None, None, 4)
    expected = spline(model, light, view, some)
    seen = resample(model, light, view).decode(y=some, x=some)
    error = np.sum((seen - expected) ** 2) / np.sum(expected**2)
    assert -10.0 * np.log10(error) > least_db
