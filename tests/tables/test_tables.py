"""The tables and their evaluation on the CPU against the model they are made of."""

from dataclasses import replace

import numpy as np
import pytest
from kinds import KINDS, SHAPE
from measured import WOOL, compressed
from small_btf import hemisphere, make_model

from addon.datasets.directions import spherical_to_unit
from addon.errors import Cancelled, NacreError
from addon.models.clustered_tucker import ClusteredTucker
from addon.models.exr import load_model
from addon.models.interpolation import thin_plate_weights
from addon.tables.against_model import tables_against_model
from addon.tables.evaluate import evaluate_occlusion, evaluate_patch, evaluate_points
from addon.tables.parabolic import texel_directions, texel_of
from addon.tables.tables import build_tables

SIZE = 16
EACH = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)


def texels(count, seed):
    """The directions of so many texels of a map of SIZE, those at the horizon left out."""
    directions = texel_directions(SIZE).reshape(-1, 3)
    directions = directions[directions[:, 2] > 0.1]
    return np.random.default_rng(seed).permutation(directions)[:count]


def on_texels(kind):
    """A model measured in just the directions that texels of the tables stand for."""
    model = make_model(SHAPE, **kind)
    light, view = texels(SHAPE[0], 1), texels(SHAPE[1], 2)
    dataset = {**model.dataset, "light": light.tolist(), "view": view.tolist()}
    return replace(model, dataset=dataset), light, view


def positive(model):
    return replace(
        model,
        core=np.abs(model.core),
        bases={mode: np.abs(basis) for mode, basis in model.bases.items()},
    )


def close(seen, expected):
    np.testing.assert_allclose(seen, expected, rtol=1e-3, atol=1e-4 * np.abs(expected).max())


@EACH
def test_measured_directions_are_the_models(kind):
    model, light, view = on_texels(kind)
    tables = build_tables(model, SIZE)
    seen = evaluate_patch(tables, light, view)
    assert seen.shape == SHAPE
    assert seen.dtype == np.float32
    close(seen, np.maximum(model.decode(), 0.0))


def test_clusters_that_greedy_search_misses_are_kept():
    """Every view lies in clusters 0 and 1, but cluster 2 alone comes nearer to it than either."""
    kind = {
        "ranks": (4, 1, 3, 3),
        "clusters": {"view": 3},
        "mixtures": {"view": 2},
        "shared": ("light", "y", "x"),
    }
    model, light, view = on_texels(kind)
    first, second, other = model.core
    bases = {
        mode: np.linalg.qr(basis[0, :, 0])[0][None, :, None] if mode != "view" else basis * 0 + 1
        for mode, basis in model.bases.items()
    }
    members = np.tile(np.array([0, 1], np.uint32), (SHAPE[1], 1))
    core = np.stack([first, second, first + second + 0.2 * other])
    model = replace(model, core=core, bases=bases, members={"view": members})
    close(evaluate_patch(build_tables(model, SIZE), light, view), np.maximum(model.decode(), 0.0))


def test_tables_are_packed_in_quads_filled_up_with_zeros():
    tables = build_tables(make_model(SHAPE, **KINDS["kcta"]), SIZE)
    assert tables.size == SIZE
    assert tables.core.shape == (1, 4, 6, 1, 5, 6, 4)
    assert tables.view.shape == (1, 2, 1, SIZE, SIZE, 4)
    assert tables.view_index.shape == (2, SIZE, SIZE)
    assert tables.light_index.shape == (1, SIZE, SIZE)
    assert tables.light.shape == (1, 3, 1, 2, SIZE, SIZE, 4)
    for array in (tables.core, tables.view, tables.light):
        assert array.dtype == np.float32
        assert np.isfinite(array).all()
    assert tables.view_index.dtype == tables.light_index.dtype == np.uint32
    assert tables.view_index.max() < 4
    assert tables.light_index.max() == 0
    np.testing.assert_array_equal(tables.core[..., 3], 0.0)  # R_view is 3
    np.testing.assert_array_equal(tables.view[..., 3], 0.0)
    np.testing.assert_array_equal(tables.light[:, :, :, 1, ..., 2:], 0.0)  # R_light is 6
    assert tables.fetches == {"core": 12, "view": 2, "index": 1, "light": 6}


def test_what_the_nonzeros_of_mkcta_need_is_fetched():
    """At Hole's setting 72 RGBA texels a light: 36 of the core, 9 of the views, 27 of the light."""
    kind = {"ranks": (4, 4, 3, 3), "clusters": {"light": 4, "view": 5}, "shared": ("y", "x")}
    model = make_model(SHAPE, mixtures={"light": 3, "view": 3}, **kind)
    tables = build_tables(model, SIZE)
    assert tables.light.shape == (5, 3, 3, 1, SIZE, SIZE, 4)
    assert tables.view.shape == (4, 3, 1, SIZE, SIZE, 4)
    assert tables.fetches == {"core": 36, "view": 9, "index": 2, "light": 27}


def test_values_linear_in_the_directions_are_linear_between_them():
    """N-SVD of (a + b.l) (c + d.v) texture: splines of any data reproduce linear functions."""
    light, view = hemisphere(20), hemisphere(25)
    model = make_model((20, 25, 5, 6, 3), (4, 4, 3, 3))
    rng = np.random.default_rng(0)
    of_light, of_view = rng.normal(size=(4, 3, 4)), rng.normal(size=(4, 4))

    def rows(directions):
        return np.column_stack([np.ones(len(directions)), directions])

    def with_directions(light, view):
        bases = {
            **model.bases,
            "light": np.einsum("ld,dcr->lcr", rows(light), of_light).reshape(1, -1, 1, 4),
            "view": (rows(view) @ of_view)[None, :, None],
        }
        bases = {mode: basis.astype(np.float32) for mode, basis in bases.items()}
        dataset = {**model.dataset, "light": light.tolist(), "view": view.tolist()}
        return replace(model, bases=bases, dataset=dataset)

    tables = build_tables(with_directions(light, view), SIZE)
    # Texels no lower than the spirals go, which is 80 degrees.
    lights, views = (d[d[:, 2] > 0.18] for d in (texels(30, 3), texels(30, 4)))
    expected = with_directions(lights, views).decode()
    close(evaluate_patch(tables, lights, views), np.maximum(expected, 0.0))


def test_all_clusters_mixed_are_a_spline_of_the_samples():
    """With K = C nothing is lost in the clusters, so the values are the spline of the model's."""
    model = make_model(
        SHAPE, (4, 3, 3, 3), clusters={"view": 2}, mixtures={"view": 2}, shared=("light",)
    )
    measured_light, measured_view = hemisphere(SHAPE[0]), hemisphere(SHAPE[1])
    light, view = (d[d[:, 2] > 0.18] for d in (texels(20, 5), texels(20, 6)))
    expected = np.einsum(
        "al,bv,lvyxc->abyxc",
        thin_plate_weights(measured_light, light),
        thin_plate_weights(measured_view, view),
        model.decode(),
    )
    tables = build_tables(model, SIZE)
    close(evaluate_patch(tables, light, view), np.maximum(expected, 0.0))


@EACH
def test_points_at_texel_centres_are_the_patch(kind):
    model = make_model(SHAPE, **kind)
    tables = build_tables(model, SIZE)
    light, view = hemisphere(9)[3:8], hemisphere(11)[5:10]
    patch = evaluate_patch(tables, light, view)
    rows, columns = np.indices(SHAPE[2:4]).reshape(2, -1)
    uv = np.column_stack([(columns + 0.5) / SHAPE[3], (rows + 0.5) / SHAPE[2]])
    for number in range(5):
        for turn in ((0, 0), (3, -2)):  # the patch repeats
            directions = (np.repeat(d[number][None], len(uv), 0) for d in (light, view))
            points = evaluate_points(tables, *directions, uv + turn)
            close(points, patch[number, number, rows, columns])


@EACH
def test_between_texel_centres_values_are_bilinear_and_periodic(kind):
    tables = build_tables(positive(make_model(SHAPE, **kind)), SIZE)
    # Positive at the direction in question, or the clamp is not linear.
    light, view = hemisphere(9)[:1], hemisphere(9)[:1]
    patch = evaluate_patch(tables, light, view)[0, 0].astype(float)
    assert patch.min() > 0.0
    height, width = SHAPE[2:4]
    uv = np.random.default_rng(7).uniform(-1, 2, (200, 2))
    x, y = uv[:, 0] * width - 0.5, uv[:, 1] * height - 0.5
    left, low = np.floor(x).astype(int), np.floor(y).astype(int)
    a, b = (x - left)[:, None], (y - low)[:, None]

    def texel(row, column):
        return patch[row % height, column % width]

    expected = (
        (1 - a) * (1 - b) * texel(low, left)
        + a * (1 - b) * texel(low, left + 1)
        + (1 - a) * b * texel(low + 1, left)
        + a * b * texel(low + 1, left + 1)
    )
    n = len(uv)
    close(evaluate_points(tables, np.repeat(light, n, 0), np.repeat(view, n, 0), uv), expected)


@EACH
def test_light_below_the_horizon_is_dark(kind):
    tables = build_tables(positive(make_model(SHAPE, **kind)), SIZE)
    view = spherical_to_unit([20.0], [100.0])
    below = spherical_to_unit([90.0, 91.0, 135.0, 180.0], [0.0, 30.0, 200.0, 0.0])
    below[0, 2] = 0.0
    np.testing.assert_array_equal(evaluate_patch(tables, below, view), 0.0)
    points = evaluate_points(tables, below, np.repeat(view, 4, 0), np.full((4, 2), 0.3))
    np.testing.assert_array_equal(points, 0.0)
    above = evaluate_patch(tables, spherical_to_unit([0.0], [0.0]), view)
    assert above.max() > 0.0


@EACH
def test_a_view_below_the_horizon_sees_the_horizon(kind):
    """So that a silhouette has no holes."""
    tables = build_tables(make_model(SHAPE, **kind), SIZE)
    light = spherical_to_unit([30.0], [0.0])
    low, lower = (spherical_to_unit([theta], [77.0]) for theta in (90.0, 120.0))
    np.testing.assert_array_equal(
        evaluate_patch(tables, light, lower), evaluate_patch(tables, light, low)
    )


def test_light_fades_out_towards_the_horizon():
    """Values hold the light's cosine: below the lowest light measured it is what changes."""
    light = spherical_to_unit([0.0, *[60.0] * 6], [0.0, *np.arange(6) * 60.0])
    model = make_model((7, 14, 5, 6, 3), (4, 4, 3, 3))
    model = replace(model, dataset={**model.dataset, "light": light.tolist()})
    size = 256
    tables = build_tables(model, size)
    # Along an azimuth that was measured; the directions are those of texels.
    wanted = spherical_to_unit([60.0, 70.0, 80.0, 85.0], [0.0] * 4)
    column, row = texel_of(wanted, size).T
    wanted = texel_directions(size)[row, column]
    values = tables.light[0, :, 0, 0, row, column].astype(float).swapaxes(0, 1)
    reflectance = values / wanted[:, 2][None, :, None]
    np.testing.assert_allclose(reflectance[:, 1:], reflectance[:, 1:2].repeat(3, 1), rtol=1e-4)
    rim_column, rim_row = texel_of(np.array([1.0, 0.0, 0.0]), size)
    np.testing.assert_allclose(tables.light[..., rim_row, rim_column, :], 0.0, atol=1e-6)


def test_one_light_and_one_view_are_enough():
    model = make_model((1, 1, 4, 4, 3), (3, 1, 2, 2))
    tables = build_tables(model, SIZE)
    up = np.array([[0.0, 0.0, 1.0]])
    close(evaluate_patch(tables, up, up), np.maximum(model.decode(), 0.0))


@pytest.mark.parametrize("clusters", [{"y": 2}, {"y": 2, "x": 2}, {"view": 2, "y": 2}])
def test_clustered_texels_are_refused(clusters):
    with pytest.raises(NacreError) as error:
        build_tables(make_model(clusters=clusters), SIZE)
    assert " and ".join(mode for mode in clusters if mode != "view") in str(error.value)
    assert "lights or views" in str(error.value)
    assert "\n" not in str(error.value)


def test_logarithms_are_refused():
    model = make_model((3, 4, 5, 6, 3))
    model = replace(model, fit={**model.fit, "domain": "log"})
    with pytest.raises(NacreError) as error:
        build_tables(model, SIZE)
    assert "--domain linear" in str(error.value)
    assert "\n" not in str(error.value)


def test_progress_rises_to_1_and_a_no_stops():
    model = make_model(SHAPE, **KINDS["kcta"])
    seen = []
    build_tables(model, SIZE, lambda *now: seen.append(now) or True)
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)
    assert (fractions[0], fractions[-1]) == (0.0, 1.0)
    for stop in range(len(seen)):
        answers = iter([True] * stop + [False])
        with pytest.raises(Cancelled):
            build_tables(model, SIZE, lambda *_, answers=answers: next(answers))


@EACH
def test_the_error_against_the_model_is_that_of_every_measured_pair(kind):
    model = make_model(SHAPE, **kind)  # between texels, so that there is an error
    tables = build_tables(model, SIZE)
    light, view = (np.asarray(model.dataset[mode]) for mode in ("light", "view"))
    expected = np.maximum(model.decode(), 0.0)
    error = np.abs(evaluate_patch(tables, light, view) - expected)
    found = tables_against_model(model, tables)
    assert found["mean_abs"] == pytest.approx(error.mean(), rel=1e-4)
    assert found["relative"] == pytest.approx(error.mean() / expected.mean(), rel=1e-4)
    assert found["max_abs"] == pytest.approx(error.max(), rel=1e-4)
    assert found["relative"] > 0.001


@pytest.mark.parametrize("setting", ["nsvd", "k3"])
def test_on_the_measured_grid_tables_are_close_to_the_model(setting, tmp_path_factory):
    model = load_model(compressed(WOOL, setting, tmp_path_factory))
    light, view = (np.asarray(model.dataset[mode]) for mode in ("light", "view"))
    some = slice(None, None, 4)
    expected = np.maximum(model.decode(some, some), 0.0)
    errors = []
    for size in (64, 128, 256):
        seen = evaluate_patch(build_tables(model, size), light[some], view[some])
        errors.append(np.abs(seen - expected).mean() / expected.mean())
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.02
    assert errors[2] < 0.6 * errors[0]


@pytest.mark.parametrize("clusters", [{}, {"view": 3}], ids=["nsvd", "kcta"])
def test_occlusion_at_measured_views_is_the_models(clusters):
    """Signed distances: not clamped."""
    rng = np.random.default_rng(3)
    count = clusters.get("view", 1)
    view = texels(14, 2)
    model = ClusteredTucker(
        core=rng.normal(size=(count, 3, 2, 3)).astype(np.float32),
        bases={
            "view": rng.normal(size=(1, 14, 2 if clusters else 1, 3)).astype(np.float32),
            "y": rng.normal(size=(count, 5, 1, 2)).astype(np.float32),
            "x": rng.normal(size=(count, 6, 1, 3)).astype(np.float32),
        },
        members={m: np.array([[0, 1], [1, 2]] * 7, np.uint32) for m in clusters},
        clusters=clusters,
        dataset={"view": view.tolist(), "value": "distance"},
        kind="occlusion",
    )
    tables = build_tables(model, SIZE)
    assert tables.light is None and tables.channels == 1
    seen = evaluate_occlusion(tables, view)
    close(seen, model.decode())
    assert seen.min() < 0.0
