"""Environment light in both engines against the same tables on the CPU."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import bpy
import numpy as np
import pytest
from small_btf import make_model as small_model

from addon.errors import NacreError
from addon.models.clustered_tucker import ClusteredTucker
from addon.nodes import atlas
from addon.nodes.atlas import make_image
from addon.nodes.environment_light import environment_radiance
from addon.nodes.evaluation import Evaluation
from addon.nodes.graph import Graph
from addon.nodes.packed_environment import PackedEnvironment, pack_environment, refill_environment
from addon.nodes.packed_tables import pack
from addon.nodes.texel_group import make_texel_group
from addon.render.engines import NODE_ENGINES, render_pixels, set_engine
from addon.render.stage import add_camera, add_mesh, new_scene, unit
from addon.tables.environment import (
    EnvironmentTable,
    build_environment,
    evaluate_environment,
)
from addon.tables.light_lobes import light_lobes
from addon.tables.tables import Tables, build_tables
from addon.tables.world_picture import picture_directions

PIXELS = 24
VIEW = (30.0, 60.0)


def picture(scale: float = 1.0) -> np.ndarray:
    """An environment without symmetry."""
    x, y, z = np.moveaxis(picture_directions(32, 64), -1, 0)
    sun = 30.0 * np.exp(40.0 * (0.48 * x - 0.6 * y + 0.64 * z - 1.0))
    return scale * np.stack([1.0 + x + sun, 1.2 + z + 0.5 * sun, 1.1 - y + 0.2 * sun], -1)


def table_of(tables: Tables, radiance: np.ndarray) -> EnvironmentTable:
    return build_environment(light_lobes(tables), radiance, 9)


def frames(seed: int = 0) -> np.ndarray:
    """Random frames (n, 3, 3), every third one left-handed; some along the axes."""
    rng = np.random.default_rng(seed)
    found = np.linalg.qr(rng.standard_normal((PIXELS**2, 3, 3)))[0]
    left = np.linalg.det(found) < 0
    found[left != (np.arange(len(found)) % 3 == 0), 1] *= -1
    found[0], found[1], found[2] = np.eye(3), -np.eye(3), np.eye(3)[[1, 0, 2]]
    return found


MKCTA = {
    "ranks": (2, 2, 3, 3),
    "clusters": {"light": 3, "view": 2},
    "mixtures": {"light": 2, "view": 2},
    "shared": ("y", "x"),
}


def expected(tables: Tables, table: EnvironmentTable) -> np.ndarray:
    y, x = np.divmod(np.arange(PIXELS**2), PIXELS)
    uv = (np.column_stack([x, y]) + 0.5) / PIXELS
    views = np.tile(unit(VIEW), (len(uv), 1))
    return evaluate_environment(tables, table, frames(), views, uv)


def shown(tables: Tables, environment: PackedEnvironment, scale: float, engine: str) -> np.ndarray:
    """The flat patch, each pixel with a frame of its own."""
    material = bpy.data.materials.new("Test")
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    g = Graph(tree)
    packed = pack("Test", tables)
    uv = g.wire(g.node("ShaderNodeUVMap"))
    axes = []
    for axis in range(3):
        pixels = np.ones((PIXELS, PIXELS, 4), np.float32)
        pixels[..., :3] = frames()[:, axis].reshape(PIXELS, PIXELS, 3)
        image = make_image("Axis", pixels)
        texture = g.node("ShaderNodeTexImage", uv, image=image, interpolation="Closest")
        axes.append(g.operate("ADD", g.wire(texture), (0.0, 0.0, 0.0)))
    texel_group = make_texel_group("Texel", packed)
    evaluation = Evaluation(g, packed, texel_group, uv, g.combine(*map(float, unit(VIEW))))
    channels = environment_radiance(g, evaluation, environment, *axes)
    emission = g.node("ShaderNodeEmission", g.combine(*channels) * scale)
    g.node("ShaderNodeOutputMaterial", g.wire(emission))
    with new_scene((PIXELS, PIXELS)) as scene:
        add_mesh(scene, "plane", material)
        add_camera(scene, (0.0, 0.0), 1.0)
        set_engine(scene, engine, 1)
        scene.render.filter_size = 0.0
        scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
        return render_pixels(scene).reshape(-1, 3)


def check(tables: Tables, engine: str) -> None:
    table = table_of(tables, picture())
    seen = shown(tables, pack_environment("Test Environment", table), table.scale, engine)
    wanted = expected(tables, table)
    assert wanted.std() > 0.1 * wanted.mean() > 0.0
    # Half floats of the film; the texture coordinates of a texel's edge may fall on either side.
    assert np.abs(seen - wanted).mean() < 0.005 * wanted.mean()


@pytest.mark.parametrize("engine", NODE_ENGINES)
def test_any_frame_mirrored_or_not(engine: str, make_model: Callable[..., ClusteredTucker]) -> None:
    check(build_tables(make_model(ranks=(3, 2, 5, 4)), size=32), engine)


@pytest.mark.parametrize("engine", NODE_ENGINES)
def test_clusters_of_lights(engine: str) -> None:
    """Clusters of lights and of views, with light rows of their own."""
    model = small_model((12, 14, 5, 6, 3), **MKCTA)
    model = replace(model, core=np.abs(model.core))
    check(build_tables(model, size=32), engine)


def test_paper_sized_models_fit_cycles_stack(
    make_model: Callable[..., ClusteredTucker],
) -> None:
    """K-CTA at Corduroy's ranks and MK-CTA at Hole's: at most 255 values live."""
    check(build_tables(make_model(8, 3, ranks=(20, 4, 5, 4)), size=32), "cycles")
    hole = {
        "clusters": {"light": 4, "view": 5},
        "mixtures": {"light": 3, "view": 3},
        "shared": ("y", "x"),
    }
    model = small_model((12, 14, 5, 6, 3), (4, 4, 3, 3), **hole)
    check(build_tables(replace(model, core=np.abs(model.core)), size=32), "cycles")


def test_another_environment_changes_the_image_alone(
    make_model: Callable[..., ClusteredTucker],
) -> None:
    tables = build_tables(make_model(ranks=(3, 2, 5, 4)), size=32)
    packed = pack_environment("Test Environment", table_of(tables, picture()))
    other = table_of(tables, picture()[:, ::-1] * 2.0)
    assert refill_environment(packed, other)
    assert len(bpy.data.images) == 1
    wanted = expected(tables, other)
    seen = shown(tables, packed, other.scale, "cycles")
    assert np.abs(seen - wanted).mean() < 0.005 * wanted.mean()
    assert not refill_environment(packed, build_environment(light_lobes(tables), picture(), 7))


def test_too_large_for_a_texture(
    make_model: Callable[..., ClusteredTucker], monkeypatch: pytest.MonkeyPatch
) -> None:
    table = table_of(build_tables(make_model(), size=32), picture())
    monkeypatch.setattr(atlas, "LARGEST", 64)
    with pytest.raises(NacreError, match="is the limit"):
        pack_environment("Test Environment", table)
    assert not bpy.data.images
