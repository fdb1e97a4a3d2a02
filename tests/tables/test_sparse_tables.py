"""Sparse tables against the model that they were made of."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("nacre_native")

from small_sparse import model_of

from addon.datasets.directions import spherical_to_unit
from addon.models.sparse.interpolation import at_directions
from addon.tables.sparse_evaluate import evaluate_sparse_patch, evaluate_sparse_points
from addon.tables.sparse_tables import build_sparse_tables

LIGHTS = spherical_to_unit(np.array([8.0, 25, 42, 61]), np.array([10.0, 130, 250, 310]))
VIEWS = spherical_to_unit(np.array([5.0, 33, 50, 58]), np.array([77.0, 200, 15, 290]))


@pytest.mark.parametrize(("parts", "own_means"), [("", True), ("YUV", True), ("", False)])
def test_tables_have_the_model_between_its_directions(parts: str, own_means: bool) -> None:
    model = model_of(parts, own_means=own_means)
    wanted = at_directions(model, LIGHTS, VIEWS)
    expected = np.stack([wanted.decode(slice(i, i + 1), slice(i, i + 1))[0, 0] for i in range(4)])
    found = evaluate_sparse_patch(build_sparse_tables(model), LIGHTS, VIEWS)
    assert found.shape == (4, 10, 9, 3)
    assert np.abs(found - np.maximum(expected, 0)).mean() < 0.01 * expected.mean()


def test_points_are_the_nearest_texels_and_repeat() -> None:
    tables = build_sparse_tables(model_of())
    whole = evaluate_sparse_patch(tables, LIGHTS[:1], VIEWS[:1])[0]
    uv = np.array([(0.01, 0.02), (3.96, -0.03), (0.5, 0.5)])
    light, view = (np.repeat(own[:1], 3, 0) for own in (LIGHTS, VIEWS))
    found = evaluate_sparse_points(tables, light, view, uv)
    expected = [whole[0, 0], whole[9, 8], whole[5, 4]]
    assert np.allclose(found, expected, rtol=1e-5)


def test_light_fades_to_nothing_at_the_horizon() -> None:
    model = model_of()
    tables = build_sparse_tables(model)
    low = spherical_to_unit(np.array([79.0, 85.0, 90.0, 100.0]), np.zeros(4))
    views = np.repeat(VIEWS[:1], 4, 0)
    means = evaluate_sparse_patch(tables, low, views).mean((1, 2, 3))
    assert means[0] > means[1] > means[2]
    assert means[2] == pytest.approx(0.0, abs=1e-6) and means[3] == 0.0


def test_rows_are_those_that_are_used() -> None:
    tables = build_sparse_tables(model_of())
    for part in tables.parts.values():
        rows = part.coefficients[..., 1:].astype(int)
        for number, table in enumerate((part.texels, part.light, part.view)):
            own = rows[..., number][part.coefficients[..., 0] != 0]
            assert set(range(len(table))) == set(own.ravel())
    assert build_sparse_tables(model_of(own_means=False)).fetches["coefficients"] == 36
