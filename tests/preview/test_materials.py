"""Materials as EEVEE shows them, drawn by the engine from what their nodes hold."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache
from math import pi
from pathlib import Path

import bpy
import numpy as np
import pytest

import addon
from addon.nodes.kept_world import KeptWorld
from addon.nodes.material import (
    group_of,
    material_from_tables,
    set_coordinates,
    set_environment,
    set_lights,
)
from addon.nodes.packed_environment import stored_environment
from addon.preview.appearance import Appearance, WorldLight, appearance_of
from addon.preview.draw import Resources, prepare
from addon.preview.picture import camera_picture
from addon.render.engines import render_pixels, set_engine
from addon.render.stage import add_camera, add_mesh, add_sun, new_scene
from addon.render.world_light import read_world
from addon.tables.environment import (
    EnvironmentTable,
    build_environment,
    evaluate_environment,
)
from addon.tables.light_lobes import light_lobes
from addon.tables.tables import Tables
from addon.tables.world_picture import picture_directions

pytestmark = pytest.mark.usefixtures("need_gpu")

SAMPLES = 4
STUDIO = Path(bpy.utils.system_resource("DATAFILES")) / "studiolights" / "world" / "city.exr"
MODELS = {"K-CTA": {"mixtures": (1, 2)}, "MK-CTA": {"mixtures": (2, 2), "apart": True}}


@pytest.fixture(autouse=True)
def extension() -> Iterator[None]:
    addon.register()
    yield
    addon.unregister()


@lru_cache(maxsize=1)
def studio_radiance() -> np.ndarray:
    """Of the studio world, not turned."""
    return read_world(studio()[0]).radiance


def studio() -> tuple[bpy.types.World, bpy.types.ShaderNodeMapping]:
    """A studio world, and the node that turns it. Scenes have another: to light materials it need
    not be theirs, and EEVEE takes its time for worlds."""
    world = bpy.data.worlds.new("Studio")
    if world.node_tree is None:
        world.use_nodes = True
    tree = world.node_tree
    texture, mapping, coordinates = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexEnvironment", "Mapping", "TexCoord")
    )
    texture.image = bpy.data.images.load(str(STUDIO))
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    tree.links.new(texture.outputs["Color"], tree.nodes["Background"].inputs["Color"])
    return world, mapping


def table_of(tables: Tables, radiance: np.ndarray) -> EnvironmentTable:
    return build_environment(light_lobes(tables, 0.25), radiance, 9)


def ours(scene: bpy.types.Scene, samples: int = SAMPLES) -> np.ndarray:
    layer = scene.view_layers[0]
    layer.update()
    size = scene.render.resolution_x, scene.render.resolution_y
    return camera_picture(layer.depsgraph, size, samples)[0][..., :3]


def theirs(scene: bpy.types.Scene, samples: int = SAMPLES) -> np.ndarray:
    set_engine(scene, "eevee", samples)
    scene.render.filter_size = 1.0
    return render_pixels(scene)


def apart(seen: np.ndarray, expected: np.ndarray) -> float:
    """Mean difference over the mean."""
    assert expected.std() > 0.03 * expected.mean()
    return float(np.abs(seen - expected).mean() / expected.mean())


@pytest.mark.parametrize("name", MODELS)
def test_a_world_lights_as_in_eevee(name: str, smooth_tables: Callable[..., Tables]) -> None:
    """A patch and a sphere; and as the world is turned, with no new table."""
    tables = smooth_tables(**MODELS[name])
    with new_scene((96, 48)) as scene:
        material = material_from_tables(tables, "Test")
        plane = add_mesh(scene, "plane", material)
        plane.location.x, plane.rotation_euler = -1.2, (0.3, 0.2, 0.5)
        plane.scale = (4.0, 4.0, 4.0)
        ball = add_mesh(scene, "sphere", material, repeat=1.0)
        ball.location = (1.2, 0.0, 3.0)
        add_camera(scene, (0.0, 0.0), 4.6)
        world, mapping = studio()
        kept = KeptWorld(studio_radiance(), world.name, mapping.name)
        set_environment(material, [table_of(tables, kept.radiance)], kept)
        before, shown = ours(scene), appearance_of(material).world
        mapping.inputs["Rotation"].default_value = (0.4, -0.2, 2.0)
        world.update_tag()
        seen, expected = ours(scene), theirs(scene)
        assert appearance_of(material).world.table is shown.table
    flat, round_ = (slice(4, -4), slice(2, 22)), (slice(8, -8), slice(56, 90))
    assert apart(seen[flat], expected[flat]) < 0.01
    assert apart(seen[round_], expected[round_]) < 0.01
    assert apart(seen, before) > 0.05


SHAPES = {
    "one cluster": {"mixtures": (1, 1)},
    "light rows of the views' clusters": {"mixtures": (1, 3), "apart": True},
    "clusters of lights": {"mixtures": (3, 1)},
    "of both": {"mixtures": (2, 3), "apart": True},
}


@pytest.mark.parametrize("name", SHAPES)
def test_a_world_in_all_frames_is_that_of_the_cpu(
    name: str, smooth_tables: Callable[..., Tables]
) -> None:
    """Planes turned any way, every third one mirrored."""
    tables = smooth_tables(**SHAPES[name], texels=(1, 1))
    x, y, z = np.moveaxis(picture_directions(32, 64), -1, 0)
    sun = 30.0 * np.exp(40.0 * (0.48 * x - 0.6 * y + 0.64 * z - 1.0))
    table = table_of(tables, np.stack([1.0 + x + sun, 1.2 + z + 0.5 * sun, 1.1 - y], -1))
    rng = np.random.default_rng(3)
    count = 24
    turns = rng.uniform(-np.pi, np.pi, (count, 3))
    turns[0], turns[1] = 0.0, (0.0, 0.0, np.pi)
    frames = []
    with new_scene((count, 1)) as scene:
        material = bpy.data.materials.new("Test")
        for number, turn in enumerate(turns):
            item = add_mesh(scene, "plane", material)
            item.location.x, item.rotation_euler = number - (count - 1) / 2, turn
            item.scale = (-0.5 if number % 3 == 2 else 0.5, 0.5, 0.5)
            axes = np.array(item.rotation_euler.to_matrix()).T * [[np.sign(item.scale.x)], [1], [1]]
            frames.append(axes * np.array([[1], [1], [np.sign(axes[2, 2])]]))
        add_camera(scene, (0.0, 0.0), float(count))
        scene.view_layers[0].update()
        seen = camera_picture(
            scene.view_layers[0].depsgraph,
            (count, 1),
            1,
            lambda _material: Appearance(btf=tables, world=WorldLight(table)),
        )[0][0, :, :3]
    frames = np.array(frames)
    uv = np.full((count, 2), 0.5)
    expected = evaluate_environment(tables, table, frames, frames[:, :, 2], uv)
    assert expected.std(0).min() > 0.1 * expected.mean()
    np.testing.assert_allclose(seen, expected, rtol=0.01)


def test_keys_turn_the_world(smooth_tables: Callable[..., Tables]) -> None:
    """In a final render, too, that the file's own world does not follow."""
    tables = smooth_tables()
    radiance = np.zeros((32, 64, 3))
    radiance[20:, :20] = 1.0, 0.5, 0.2
    with new_scene((16, 16)) as scene:
        material = material_from_tables(tables, "Test")
        add_mesh(scene, "plane", material)
        add_camera(scene, (20.0, 250.0), 0.5)
        scene.render.engine = "NACRE"
        world, mapping = studio()
        kept = KeptWorld(radiance, world.name, mapping.name)
        set_environment(material, [table_of(tables, radiance)], kept)
        pictures = {}
        for turn in (0.0, 1.5):
            mapping.inputs["Rotation"].default_value = turn, 0.0, 0.0
            world.update_tag()
            pictures[turn] = ours(scene)
            mapping.inputs["Rotation"].keyframe_insert("default_value", frame=1 + 10 * turn)
        assert apart(pictures[1.5], pictures[0.0]) > 0.2
        for turn, expected in pictures.items():
            scene.frame_set(int(1 + 10 * turn))
            assert apart(ours(scene), expected) < 0.01
        # A final render's world is another copy: a background's is that of the first frame here.
        assert apart(render_pixels(scene), pictures[0.0]) < 0.01


def test_a_world_that_is_read_again_is_shown(smooth_tables: Callable[..., Tables]) -> None:
    """Another table takes the place of the last one in the same image."""
    tables = smooth_tables()
    radiance = np.zeros((32, 64, 3))
    radiance[20:, :20] = 1.0, 0.5, 0.2
    with new_scene((16, 16)) as scene:
        material = material_from_tables(tables, "Test")
        add_mesh(scene, "plane", material)
        add_camera(scene, (20.0, 250.0), 0.5)
        set_environment(material, [table_of(tables, radiance)], KeptWorld(radiance))
        image = stored_environment(group_of(material)).atlas.image
        before = ours(scene)
        for other in (2.0 * radiance, radiance[:, ::-1]):
            set_environment(material, [table_of(tables, other)], KeptWorld(other))
            assert stored_environment(group_of(material)).atlas.image == image
            ratio = ours(scene).mean() / before.mean()
            assert ratio == pytest.approx(2.0, rel=1e-3) if other.max() > 1.0 else ratio != 1.0
        set_environment(material, [None], None)
        assert ours(scene).max() == 0.0


def test_a_map_of_coordinates_lays_the_patch_as_in_eevee(
    smooth_tables: Callable[..., Tables],
) -> None:
    rng = np.random.default_rng(5)
    coordinates = np.stack([rng.integers(0, 12, (24, 16)), rng.integers(0, 10, (24, 16))], -1)
    tables = smooth_tables(**MODELS["MK-CTA"])
    with new_scene((100, 96)) as scene:
        material = material_from_tables(tables, "Test", scene)
        item = add_mesh(scene, "plane", material)
        add_camera(scene, (0.0, 0.0), 1.0)
        for corner in item.data.uv_layers[0].uv:  # over the edge of the map
            corner.vector = 1.3 * corner.vector[0] + 0.9, 1.3 * corner.vector[1] - 0.4
        add_sun(scene, (30.0, 60.0)).data.use_shadow = False
        set_lights(material, scene)
        plain = ours(scene)
        set_coordinates(material, coordinates)
        seen, expected = ours(scene), theirs(scene)
    assert apart(seen, plain) > 0.05
    assert apart(seen, expected) < 0.01


def test_a_collections_lights_alone_light_its_material(
    smooth_tables: Callable[..., Tables],
) -> None:
    tables = smooth_tables()
    own = bpy.data.collections.new("Own")
    with new_scene((32, 32)) as scene:
        scene.collection.children.link(own)
        lit = {
            "scene": material_from_tables(tables, "Scene", scene),
            "collection": material_from_tables(tables, "Collection", own),
        }
        add_mesh(scene, "plane", lit["scene"])
        add_camera(scene, (0.0, 0.0), 1.0)
        add_sun(scene, (50.0, 60.0)).data.energy = 5.0
        lamp = bpy.data.objects.new("Point", bpy.data.lights.new("Point", "POINT"))
        lamp.data.energy, lamp.data.color = 20.0, (1.0, 0.3, 0.1)
        lamp.location = (0.2, 0.1, 0.8)
        own.objects.link(lamp)
        for item in scene.objects:
            if item.type == "LIGHT":
                item.data.use_shadow = False
        pictures = {}
        for kind, owner in (("scene", scene), ("collection", own)):
            set_lights(lit[kind], owner)
            scene.objects["plane"].data.materials[0] = lit[kind]
            seen, expected = ours(scene), theirs(scene)
            assert apart(seen, expected) < 0.01
            pictures[kind] = seen
        assert apart(pictures["scene"], pictures["collection"]) > 0.3
        # Both at once, each by its own.
        add_mesh(scene, "plane", lit["scene"]).location.x = 2.0
        layer = scene.view_layers[0]
        layer.update()
        prepared = prepare(layer.depsgraph, Resources(), appearance_of)
        assert set(prepared.lights) == {"", "Own"}
        assert prepared.count == 2


def test_a_collection_without_lights_leaves_its_material_dark(
    smooth_tables: Callable[..., Tables],
) -> None:
    with new_scene((8, 8)) as scene:
        own = bpy.data.collections.new("None")
        material = material_from_tables(smooth_tables(), "Test", own)
        add_mesh(scene, "plane", material)
        add_camera(scene, (0.0, 0.0), 0.5)
        add_sun(scene, (0.0, 0.0)).data.energy = pi
        assert ours(scene).max() == 0.0
        set_lights(material, scene)
        assert ours(scene).min() > 0.0
