"""Sparse tables against the model that they were made of."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("nacre_native")

from addon.datasets.direction_sets import ubo_81, uniform
from addon.datasets.directions import spherical_to_unit
from addon.models.sparse.ensemble import Ensemble
from addon.models.sparse.interpolation import at_directions
from addon.models.sparse.model import Codes, SparseBtf
from addon.models.sparse.transform import Normalisation
from addon.tables.sparse_evaluate import evaluate_sparse_patch, evaluate_sparse_points
from addon.tables.sparse_tables import build_sparse_tables


def smooth(directions: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Orthonormal columns that change slowly from one direction to the next: (count of columns)."""
    random = np.random.default_rng(seed)
    x, y, z = directions.T
    basis = np.stack([np.ones_like(x), x, y, z, x * y, x * x - y * y, x * z, y * z], 1)
    rest = random.normal(size=(len(x), len(x) - basis.shape[1]))
    whole = np.linalg.qr(np.hstack([basis, rest]))[0]
    assert count <= basis.shape[1]
    return whole


def model_of(parts: str = "", seed: int = 0) -> SparseBtf:
    """10 x 9 texels in patches of 4 x 4, two dictionaries; coefficients only on smooth atoms."""
    random = np.random.default_rng(seed)
    light, view = uniform(40), ubo_81()
    tall = wide = 4
    keys = (parts,) if parts else ("Y", "U", "V")
    dictionaries, codes = {}, {}
    for number, key in enumerate(keys):
        spatial = [
            np.stack([np.linalg.qr(random.normal(size=(size, size)))[0] for _ in range(2)])
            for size in (tall, wide)
        ]
        angular = [
            np.stack([smooth(own, 8, 10 * number + k) for k in range(2)]) for own in (light, view)
        ]
        colour = [np.stack([np.linalg.qr(random.normal(size=(3, 3)))[0]] * 2)] if parts else []
        modes = [own.astype(np.float32) for own in (*spatial, *angular, *colour)]
        dictionaries[key] = tuple(modes)
        count, patches = 12, 3 * 3
        places = [random.integers(0, 4, (count, patches)) for _ in range(2)]
        places += [random.integers(0, 8, (count, patches)) for _ in range(2)]
        places += [random.integers(0, 3, (count, patches)) for _ in colour]
        positions = np.ravel_multi_index(places, [own.shape[2] for own in modes])
        values = np.sort(np.abs(random.normal(0, 3, (count, patches))), 0)[::-1]
        values[-2:, ::2] = 0.0  # not all patches have all of them
        codes[key] = Codes(
            np.where(values != 0, positions, 0).astype(np.uint32),
            values.astype(np.float32),
            random.integers(0, 2, patches).astype(np.uint32),
        )
    mean = -1.5 + np.outer(light[:, 2], view[:, 2]) + 0.3 * np.outer(light[:, 0], view[:, 1])
    deviation = 0.4 + 0.2 * np.outer(light[:, 2], view[:, 2])
    return SparseBtf(
        height=10,
        width=9,
        ensemble=Ensemble((tall, wide), light, view, dictionaries, 0.01),
        normalised=Normalisation(mean.astype(np.float32), deviation.astype(np.float32), 0.01),
        codes=codes,
        dataset={"light": light.tolist(), "view": view.tolist()},
        quality=16,
    )


LIGHTS = spherical_to_unit(np.array([8.0, 25, 42, 61]), np.array([10.0, 130, 250, 310]))
VIEWS = spherical_to_unit(np.array([5.0, 33, 50, 58]), np.array([77.0, 200, 15, 290]))


@pytest.mark.parametrize("parts", ["", "YUV"])
def test_tables_have_the_model_between_its_directions(parts: str) -> None:
    model = model_of(parts)
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
    assert tables.fetches["coefficients"] == 36
