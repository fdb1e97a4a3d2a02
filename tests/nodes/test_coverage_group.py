"""Holes by alpha in both engines against the same tables on the CPU."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from addon.datasets.directions import spherical_to_unit
from addon.datasets.occlusion import MAPPINGS, visibility
from addon.models.clustered_tucker import ClusteredTucker
from addon.nodes.material import COVERAGE_NODE, material_from_tables, set_coverage
from addon.render.engines import NODE_ENGINES, render_pixels
from addon.render.pictures import flat_scene
from addon.render.stage import unit
from addon.tables.evaluate import evaluate_occlusion
from addon.tables.tables import Tables, build_tables

VIEW = (35.0, 80.0)


@pytest.fixture(scope="module")
def holes() -> Tables:
    """Signed distances, in clusters of views."""
    rng = np.random.default_rng(3)
    directions = spherical_to_unit([0.0, *[40.0] * 6, *[70.0] * 7], np.arange(14) * 51.0)
    model = ClusteredTucker(
        core=(0.2 * rng.normal(size=(3, 3, 4, 3))).astype(np.float32),
        bases={
            "view": rng.normal(size=(1, 14, 2, 3)).astype(np.float32),
            "y": rng.normal(size=(3, 12, 1, 4)).astype(np.float32),
            "x": rng.normal(size=(3, 10, 1, 3)).astype(np.float32),
        },
        members={"view": np.array([[0, 1], [1, 2]] * 7, np.uint32)},
        clusters={"view": 3},
        dataset={"view": directions.tolist(), "value": "signed-distance"},
        kind="occlusion",
    )
    return build_tables(model, 32)


@pytest.mark.parametrize("engine", NODE_ENGINES)
def test_holes_show_what_is_behind(engine: str, tables: Tables, holes: Tables) -> None:
    """Under no light the material is black, so that the world is seen through it alone."""
    distances = evaluate_occlusion(holes, unit(VIEW)[None])[0]
    expected = visibility(distances, "signed-distance")
    assert {0.0, 1.0} < set(np.unique(expected))
    material = material_from_tables(tables, "Test")
    set_coverage(material, holes, MAPPINGS["signed-distance"])
    coverage = material.node_tree.nodes[COVERAGE_NODE]
    with flat_scene(material, (10, 12), engine) as flat:
        world = flat.scene.world.node_tree.nodes["Background"].inputs["Color"]
        world.default_value = (1.0, 1.0, 1.0, 1.0)
        for link in list(coverage.inputs["View"].links):
            material.node_tree.links.remove(link)
        coverage.inputs["View"].default_value = unit(VIEW)
        flat.scene.cycles.samples = flat.scene.eevee.taa_render_samples = 64
        flat.scene.cycles.pixel_filter_type = "GAUSSIAN"  # the middle of each pixel
        seen = 1.0 - render_pixels(flat.scene)[..., 0]
    # Alpha is met by chance, sample by sample.
    assert np.abs(seen - expected)[(expected == 0.0) | (expected == 1.0)].max() < 0.04
    assert np.abs(seen - expected).max() < 0.25


def test_holes_come_and_go(tables: Tables, holes: Tables) -> None:
    material = material_from_tables(tables, "Test")

    def kept() -> tuple[int, ...]:
        tree = material.node_tree
        return (len(tree.nodes), len(tree.links), len(bpy.data.node_groups), len(bpy.data.images))

    before = kept()
    for _ in range(2):
        set_coverage(material, holes)
        with_holes = kept()
        set_coverage(material, holes)
        assert kept() == with_holes
        set_coverage(material, None)
        assert kept() == before
