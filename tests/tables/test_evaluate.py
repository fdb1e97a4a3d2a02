"""The compiled evaluation of tables against the numpy one that it replaces."""

from dataclasses import replace

import nacre_native
import numpy as np
import pytest
from kinds import KINDS, SHAPE
from small_btf import make_model

from addon.tables.evaluate import evaluate_occlusion, evaluate_patch, evaluate_points
from addon.tables.tables import Tables, build_tables
from benchmarks import _numpy_tables

SIZE = 16
# Of one channel, of more than are summed at once, and of a patch wider than a tile is long.
SHAPES = {
    "rgb": SHAPE,
    "grey": (12, 14, 5, 6, 1),
    "five": (12, 14, 5, 6, 5),
    "wide": (6, 7, 9, 131, 3),
}


def directions(count, seed):
    """Unit vectors, a quarter of them below the horizon."""
    rng = np.random.default_rng(seed)
    vectors = rng.normal(size=(count, 3))
    vectors[:, 2] = np.abs(vectors[:, 2]) * rng.choice([1, 1, 1, -1], count)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def same(seen, expected):
    assert seen.dtype == np.float32
    assert expected.any()
    np.testing.assert_allclose(seen, expected, rtol=1e-4, atol=2e-6 * np.abs(expected).max())


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_values_are_those_of_numpy(kind, shape):
    tables = build_tables(make_model(shape, **kind), SIZE)
    light, view = directions(7, 1), directions(9, 2)
    same(evaluate_patch(tables, light, view), _numpy_tables.evaluate_patch(tables, light, view))
    # More points than one task has, on both sides of the patch's edges.
    light, view = directions(1500, 3), directions(1500, 4)
    uv = np.random.default_rng(5).uniform(-3, 3, (1500, 2))
    expected = _numpy_tables.evaluate_points(tables, light, view, uv)
    same(evaluate_points(tables, light, view, uv), expected)


@pytest.mark.parametrize("clusters", [{}, {"view": 3}], ids=["nsvd", "kcta"])
def test_occlusion_is_that_of_numpy(clusters):
    model = make_model((1, *SHAPE[1:4], 1), (1, 5, 3, 3), clusters=clusters)
    tables = replace(build_tables(model, SIZE), light=None)
    tables = replace(tables, light_index=np.zeros((1, SIZE, SIZE), np.uint32))
    view = directions(9, 2)
    expected = _numpy_tables.evaluate_occlusion(tables, view)
    assert expected.min() < 0.0  # signed distances are not clamped
    same(evaluate_occlusion(tables, view), expected)
    with pytest.raises(ValueError, match="not of occlusion"):
        evaluate_points(tables, view, view, np.zeros((9, 2)))


def test_the_number_of_threads_and_the_order_of_arrays_change_nothing():
    tables = build_tables(make_model((6, 7, 40, 64, 3), **KINDS["mkcta"]), SIZE)
    light, view = directions(8, 1), directions(3, 2)
    uv = np.random.default_rng(5).uniform(0, 1, (5000, 2))
    ways = directions(5000, 3), directions(5000, 4)

    def evaluator(tables: Tables) -> nacre_native.TableEvaluator:
        fields = ("core", "light", "view", "light_index", "view_index")
        return nacre_native.TableEvaluator(*(getattr(tables, name) for name in fields))

    turned = {
        name: np.asfortranarray(getattr(tables, name)) for name in ("core", "light", "view_index")
    }
    one, other = evaluator(tables), evaluator(replace(tables, **turned))
    for threads in (1, 2, 3):
        np.testing.assert_array_equal(
            one.patch(light, view, threads=threads), other.patch(light, view)
        )
        np.testing.assert_array_equal(
            one.points(*ways, uv, threads=threads), other.points(*ways, uv)
        )


def test_nothing_in_gives_nothing_out():
    tables = build_tables(make_model(SHAPE, **KINDS["kcta"]), SIZE)
    none, some = np.zeros((0, 3)), directions(2, 1)
    assert evaluate_points(tables, none, none, np.zeros((0, 2))).shape == (0, 3)
    assert evaluate_patch(tables, none, some).shape == (0, 2, 5, 6, 3)
    assert evaluate_patch(tables, some, none).shape == (2, 0, 5, 6, 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"core": lambda a: a[..., :3]}, "core: expected quads, got (1, 4, 6, 1, 5, 6, 3)"),
        (
            {"view": lambda a: a[:, :1]},
            "view_index: expected [1, 16, 16], got (2, 16, 16)",
        ),
        (
            {"light": lambda a: a[:, :, :, :1]},
            "light: expected [1, 3, 1, 2, 16, 16, 4], got (1, 3, 1, 1, 16, 16, 4)",
        ),
        ({"view_index": lambda a: a + 3}, "view_index: expected clusters below 4, got 6"),
        ({"light": lambda a: None}, "core: expected one light cluster and rank of occlusion"),
    ],
)
def test_tables_that_do_not_fit_together_are_refused(change, message):
    tables = build_tables(make_model(SHAPE, **KINDS["kcta"]), SIZE)
    assert tables.view_index.max() == 3
    broken = replace(tables, **{name: edit(getattr(tables, name)) for name, edit in change.items()})
    with pytest.raises(ValueError) as error:
        evaluate_patch(broken, directions(2, 1), directions(2, 1))
    assert str(error.value) == message


def test_wrong_points_are_refused():
    tables = build_tables(make_model(SHAPE, **KINDS["kcta"]), SIZE)
    some, uv = directions(3, 1), np.zeros((3, 2))
    with pytest.raises(ValueError, match=r"^light: expected 3 directions, got 2$"):
        evaluate_points(tables, some[:2], some, uv)
    with pytest.raises(ValueError, match=r"^uv: expected 2 columns, got 3$"):
        evaluate_points(tables, some, some, some)
    with pytest.raises(ValueError, match=r"^view: expected finite numbers, got nan in row 1$"):
        evaluate_points(tables, some, np.where(np.arange(3)[:, None] == 1, np.nan, some), uv)
