"""The environment's node group in both engines against the same table on the CPU."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
import pytest

from addon.errors import NacreError
from addon.models.clustered_tucker import ClusteredTucker
from addon.nodes import environment_group
from addon.nodes.atlas import make_image
from addon.nodes.environment_group import FRAME, fill_environment, make_environment_group
from addon.nodes.graph import Graph
from addon.render.engines import ENGINES, render_pixels, set_engine
from addon.render.stage import add_camera, add_mesh, new_scene
from addon.tables.environment import EnvironmentTable, build_environment, environment_vectors
from addon.tables.light_lobes import light_lobes
from addon.tables.tables import build_tables
from addon.tables.world_picture import picture_directions

PIXELS = 24


def picture(scale: float = 1.0) -> np.ndarray:
    """An environment without symmetry."""
    x, y, z = np.moveaxis(picture_directions(32, 64), -1, 0)
    sun = 30.0 * np.exp(40.0 * (0.48 * x - 0.6 * y + 0.64 * z - 1.0))
    return scale * np.stack([1.0 + x + sun, 1.2 + z + 0.5 * sun, 1.1 - y + 0.2 * sun], -1)


def table_of(model: ClusteredTucker, radiance: np.ndarray) -> EnvironmentTable:
    return build_environment(light_lobes(build_tables(model, size=32)), radiance, 9)


def frames(seed: int = 0) -> np.ndarray:
    """Random frames (n, 3, 3), every third one left-handed; some along the axes."""
    rng = np.random.default_rng(seed)
    found = np.linalg.qr(rng.standard_normal((PIXELS**2, 3, 3)))[0]
    left = np.linalg.det(found) < 0
    found[left != (np.arange(len(found)) % 3 == 0), 1] *= -1
    found[0], found[1], found[2] = np.eye(3), -np.eye(3), np.eye(3)[[1, 0, 2]]
    return found


def reduced_of(table: EnvironmentTable) -> np.ndarray:
    """A reduced vector whose values are about 1, and mostly positive."""
    mean = environment_vectors(table, frames(1))[:, 0, :, 0].mean((0, 1))
    return mean / (mean @ mean)


def shown(group: bpy.types.ShaderNodeTree, at: np.ndarray, reduced: np.ndarray, engine: str):
    """Render the group's value, each pixel with a frame of its own."""
    material = bpy.data.materials.new("Test")
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    g = Graph(tree)
    uv = g.wire(g.node("ShaderNodeUVMap"))
    node = g.node("ShaderNodeGroup", node_tree=group)
    for axis, label in enumerate(FRAME):
        pixels = np.ones((PIXELS, PIXELS, 4), np.float32)
        pixels[..., :3] = at[:, axis].reshape(PIXELS, PIXELS, 3)
        image = g.node(
            "ShaderNodeTexImage", uv, image=make_image(label, pixels), interpolation="Closest"
        )
        g.connect(g.wire(image), node.inputs[label])
    for r, value in enumerate(reduced):
        node.inputs[f"Reduced {r}"].default_value = value
    node.inputs["Strength"].default_value = group.interface.items_tree["Strength"].default_value
    g.node("ShaderNodeOutputMaterial", g.wire(g.node("ShaderNodeEmission", g.wire(node))))
    with new_scene((PIXELS, PIXELS)) as scene:
        add_mesh(scene, "plane", material)
        add_camera(scene, (0.0, 0.0), 1.0)
        set_engine(scene, engine, 1)
        scene.render.filter_size = 0.0
        scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
        return render_pixels(scene).reshape(-1, 3)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_group_is_the_table(engine: str, make_model: Callable[..., ClusteredTucker]) -> None:
    """Any frame, mirrored ones too; then another environment in the same image."""
    model = make_model()
    table = table_of(model, picture())
    reduced = reduced_of(table)
    group = make_environment_group("Nacre Test", table)
    for _ in range(2):
        vectors = environment_vectors(table, frames())[:, 0, :, 0]
        expected = np.maximum(vectors @ reduced, 0.0)
        assert expected.std() > 0.1 * expected.mean() > 0.0
        seen = shown(group, frames(), reduced, engine)
        # Half floats of the film; frames come from an image of floats.
        assert np.abs(seen - expected).max() < 0.005 * expected.max()
        table = table_of(model, picture(2.0)[:, ::-1])
        fill_environment(group, table)


def test_paper_sized_rank_fits_cycles_stack(make_model: Callable[..., ClusteredTucker]) -> None:
    table = table_of(make_model(ranks=(32, 4, 5, 4)), picture())
    reduced = reduced_of(table)
    seen = shown(make_environment_group("Nacre Test", table), frames(), reduced, "cycles")
    vectors = environment_vectors(table, frames())[:, 0, :, 0]
    expected = np.maximum(vectors @ reduced, 0.0)
    assert np.abs(seen - expected).max() < 0.005 * expected.max()


def test_another_models_table_does_not_fit(make_model: Callable[..., ClusteredTucker]) -> None:
    group = make_environment_group("Nacre Test", table_of(make_model(), picture()))
    other = table_of(make_model(ranks=(12, 3, 5, 4)), picture())
    with pytest.raises(ValueError, match="own model"):
        fill_environment(group, other)


def test_too_large_for_a_texture(
    make_model: Callable[..., ClusteredTucker], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(environment_group, "LARGEST", 64)
    with pytest.raises(NacreError, match="is the limit"):
        make_environment_group("Nacre Test", table_of(make_model(), picture()))
    assert not bpy.data.images and not bpy.data.node_groups
