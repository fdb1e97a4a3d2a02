"""Every evaluator of a model against `decode`: what is shown is what was fitted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import bpy
import numpy as np
from numpy.typing import NDArray

from ..datasets.directions import spherical_to_unit, unit_to_spherical
from ..errors import Cancelled, NacreError
from ..models.any_model import Model
from ..nodes.loops import has_zones
from ..nodes.material import material_from_tables
from ..preview.flat import FlatEvaluator
from ..tables.against_model import tables_against_model
from ..tables.any_tables import AnyTables, build_any_tables, evaluate_pictures
from ..tables.evaluate import light_rows, reduced_points
from ..tables.sparse_evaluate import evaluate_sparse_patch
from ..tables.sparse_tables import SparseTables
from ..tables.tables import Tables
from .engines import engines_here, render_pixels
from .pictures import Direction, flat_scene
from .stage import unit

PAIRS = 12
"""Light and view pairs rendered by each engine; every second one off the measured grid."""


def verify(
    model: Model,
    engines: Sequence[str] | None = None,
    progress: Callable[[float, str], bool] | None = None,
) -> dict[str, dict[str, float]]:
    """Errors of each evaluator, absolute and relative to the mean of what it is compared with; of
    all engines that run here when none are named.

    Engines' pictures of the flat patch are compared with the same tables evaluated on the CPU, and
    this, under "cpu", with their sum written out in another way. Under "tables"
    the tables are compared with the model itself on the whole measured grid, clamped at 0. Under
    "fetches", the RGBA texels read for one light at one spatial tap.
    """

    def step(fraction: float, message: str) -> None:
        if progress is not None and not progress(fraction, message):
            raise Cancelled

    step(0.0, "Building tables")
    tables = build_any_tables(model)
    engines = engines or [
        engine
        for engine in engines_here()
        if engine != "eevee" or has_zones() or not isinstance(tables, SparseTables)
    ]
    results: dict[str, dict[str, float]] = {"tables": tables_against_model(model, tables)}
    _, _, height, width, _ = model.shape
    evaluated, summed = [], []
    for light, view in direction_pairs(model):
        step(0.1, "Evaluating on the CPU")
        lights, views = (spherical_to_unit([d[0]], [d[1]]) for d in (light, view))
        patch, otherwise = _on_cpu(tables, lights, views)
        evaluated.append(patch)
        summed.append(otherwise)
    expected = np.stack(evaluated)
    results["cpu"] = errors(expected, np.stack(summed))
    for number, engine in enumerate(engines):
        pictures = []
        with _flat_pictures(engine, tables, (width, height)) as picture:
            for index, (light, view) in enumerate(direction_pairs(model)):
                step(
                    0.2 + 0.8 * (number + index / PAIRS) / len(engines),
                    f"Rendering with {engine}",
                )
                pictures.append(picture(light, view))
        results[engine] = errors(np.stack(pictures), expected)
    results["fetches"] = dict(tables.fetches)
    step(1.0, "Verified")
    return results


def _on_cpu(
    tables: AnyTables, light: NDArray[np.floating], view: NDArray[np.floating]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The patch (Y, X, channel) for one light and view, evaluated in two ways."""
    if isinstance(tables, SparseTables):
        otherwise = evaluate_sparse_patch(tables, light, view)[0]
    else:
        otherwise = _summed(tables, light, view)
    return evaluate_pictures(tables, light, view)[0, 0], otherwise


def _summed(
    tables: Tables, light: NDArray[np.floating], view: NDArray[np.floating]
) -> NDArray[np.float32]:
    """The patch (Y, X, channel) for one light and view, summed over all clusters in numpy."""
    height, width = tables.core.shape[4:6]
    rows, columns = np.indices((height, width)).reshape(2, -1)
    centres = np.column_stack([(columns + 0.5) / width, (rows + 0.5) / height])
    reduced = reduced_points(tables, np.repeat(view, len(centres), 0), centres)
    values = np.einsum("clvr,nvlr->nc", light_rows(tables, light)[0], reduced, optimize=True)
    return np.maximum(values, 0.0).reshape(height, width, -1)


@contextmanager
def _flat_pictures(
    engine: str, tables: AnyTables, size: tuple[int, int]
) -> Iterator[Callable[[Direction, Direction], NDArray[np.float32]]]:
    """An engine's pictures (height, width, 3) of the flat patch for a light and a view."""
    if engine == "glsl":
        evaluator = FlatEvaluator(tables)
        yield lambda light, view: evaluator.picture(unit(light), unit(view))
        return
    if isinstance(tables, SparseTables) and engine == "eevee" and not has_zones():
        raise NacreError(
            "EEVEE of this Blender cannot loop: of a sparse model it shows a K-CTA fit, which is "
            "not verified"
        )
    material = material_from_tables(tables, "verify")
    with flat_scene(material, size, engine) as flat:

        def picture(light: Direction, view: Direction) -> NDArray[np.float32]:
            flat.aim(light, view)
            return render_pixels(flat.scene)

        yield picture
    bpy.data.materials.remove(material)


def errors(seen: NDArray[np.floating], expected: NDArray[np.floating]) -> dict[str, float]:
    """Mean and largest absolute difference, and the mean one relative to the expected mean."""
    difference = np.abs(seen - expected)
    return {
        "mean_abs": float(difference.mean()),
        "relative": float(difference.mean() / max(float(expected.mean()), 1e-12)),
        "max_abs": float(difference.max()),
    }


def direction_pairs(
    model: Model,
) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """PAIRS of (theta, phi) in degrees for light and view, spread over the measured range; every
    second pair lies on the grid, the others between its directions."""
    lights, views = (
        np.column_stack(unit_to_spherical(np.asarray(model.dataset[mode])))
        for mode in ("light", "view")
    )
    pairs = []
    for index in range(PAIRS):
        light = lights[index * 7 * len(lights) // (8 * PAIRS)]
        view = views[(PAIRS - 1 - index) * len(views) // PAIRS]
        if index % 2:  # towards the normal, and turned: between rings and between neighbours
            light = light * (0.93, 1.0) + (1.0, 4.3)
            view = view * (0.95, 1.0) + (0.7, -5.1)
        pairs.append(((float(light[0]), float(light[1])), (float(view[0]), float(view[1]))))
    return pairs
