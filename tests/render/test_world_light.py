"""Worlds as pictures, and a white diffuser under them against Cycles' own."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from addon.nodes.graph import Graph
from addon.nodes.turning import follow_world, rotation_of, turned
from addon.render import world_light
from addon.render.engines import NODE_ENGINES, render_pixels, set_engine
from addon.render.stage import add_camera, add_mesh, new_scene
from addon.render.world_light import read_world
from addon.tables.environment import build_environment, environment_vectors
from addon.tables.light_lobes import light_lobes
from addon.tables.parabolic import texel_directions
from addon.tables.tables import Tables, quads
from addon.tables.world_picture import picture_directions, resize_picture, solid_angles

ROTATION = (0.4, -0.3, 1.1)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(world_light, "SIZE", (64, 32))
    monkeypatch.setattr(world_light, "SAMPLES", 16)


def picture() -> np.ndarray:
    """An environment without symmetry, (32, 64, 3)."""
    x, y, z = np.moveaxis(picture_directions(32, 64), -1, 0)
    sun = 8.0 * np.exp(12.0 * (0.48 * x - 0.6 * y + 0.64 * z - 1.0))
    return np.stack([1.0 + x + sun, 1.2 + z + 0.5 * sun, 1.1 - y + 0.2 * sun], -1)


def new_world(background: tuple[float, float, float] | None = None) -> bpy.types.World:
    """A world of one colour, or of the picture, turned by a Mapping node."""
    world = bpy.data.worlds.new("Test")
    if world.node_tree is None:
        world.use_nodes = True
    tree = world.node_tree
    shader = next(node for node in tree.nodes if node.type == "BACKGROUND")
    if background is not None:
        shader.inputs["Color"].default_value = (*background, 1.0)
        return world
    pixels = picture().astype(np.float32)
    height, width, _ = pixels.shape
    image = bpy.data.images.new("Sky", width, height, float_buffer=True, is_data=True)
    image.pixels.foreach_set(np.dstack([pixels, np.ones_like(pixels[..., 0])]).ravel())
    image.pack()
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = image
    mapping = tree.nodes.new("ShaderNodeMapping")
    mapping.inputs["Rotation"].default_value = ROTATION
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    tree.links.new(texture.outputs["Color"], shader.inputs["Color"])
    return world


def energy(radiance: np.ndarray) -> np.ndarray:
    return (radiance * solid_angles(*radiance.shape[:2])[:, None, None]).sum((0, 1))


def test_a_world_is_read_as_its_picture() -> None:
    """The rotation is kept apart, and nothing stays behind."""
    world = new_world()
    before = {kind: len(getattr(bpy.data, kind)) for kind in ("scenes", "worlds", "cameras")}
    light = read_world(world)
    assert light.mapping == world.node_tree.nodes["Mapping"]
    assert {kind: len(getattr(bpy.data, kind)) for kind in before} == before
    assert tuple(light.mapping.inputs["Rotation"].default_value) == pytest.approx(ROTATION)
    expected = resize_picture(picture(), 32, 64)
    assert np.abs(light.radiance - expected).mean() < 0.01 * expected.mean()


def test_a_world_of_other_nodes_is_read_as_it_is() -> None:
    """With its rotation; here because scaled directions are none that a frame can be turned for."""
    world = new_world()
    unturned = read_world(world).radiance
    world.node_tree.nodes["Mapping"].inputs["Scale"].default_value = (1.0, 1.0, 1.001)
    light = read_world(world)
    assert light.mapping is None
    assert np.abs(light.radiance - unturned).mean() > 0.1 * unturned.mean()
    np.testing.assert_allclose(energy(light.radiance), energy(unturned), rtol=0.02)


def test_a_plain_colour() -> None:
    light = read_world(new_world((0.1, 0.4, 2.0)))
    np.testing.assert_allclose(light.radiance, np.tile([0.1, 0.4, 2.0], (32, 64, 1)), rtol=1e-3)
    assert light.mapping is None


def test_no_world_is_dark() -> None:
    assert read_world(None).radiance.max() == 0.0


def test_what_only_cameras_see_is_no_light() -> None:
    """The usual trick to show another background than the light."""
    world = new_world((0.5, 0.5, 0.5))
    tree = world.node_tree
    shader = next(node for node in tree.nodes if node.type == "BACKGROUND")
    paths = tree.nodes.new("ShaderNodeLightPath")
    less = tree.nodes.new("ShaderNodeMath")
    less.operation = "SUBTRACT"
    less.inputs[0].default_value = 3.0
    tree.links.new(paths.outputs["Is Camera Ray"], less.inputs[1])
    tree.links.new(less.outputs["Value"], shader.inputs["Strength"])
    np.testing.assert_allclose(read_world(world).radiance, 1.5, rtol=1e-3)


def test_a_diffuse_sphere_is_as_in_cycles() -> None:
    """The whole way from the world to radiance, which side is which included."""
    size = 48
    with new_scene((size, size)) as scene:
        scene.world = new_world()
        material = bpy.data.materials.new("White")
        if material.node_tree is None:
            material.use_nodes = True
        tree = material.node_tree
        tree.nodes.clear()
        diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
        diffuse.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
        add_mesh(scene, "sphere", material)
        camera = add_camera(scene, (60.0, 25.0), 2.0)
        set_engine(scene, "cycles", 128)
        seen = render_pixels(scene)
        right, up, towards = np.array(camera.matrix_world.to_3x3()).T
        light = read_world(scene.world)
        turn = rotation_of(light.mapping)
    steps = (np.arange(size) + 0.5) / size * 2.0 - 1.0
    across, along = np.meshgrid(steps, steps)
    inside = across**2 + along**2 < 0.9
    x, y = across[inside], along[inside]
    normal = np.outer(x, right) + np.outer(y, up) + np.outer(np.sqrt(1 - x**2 - y**2), towards)
    tangent = np.cross(normal, [0.3, 0.5, 0.8])
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    frames = np.stack([tangent, np.cross(normal, tangent), normal], 1) @ turn.T
    table = build_environment(light_lobes(_diffuser()), light.radiance, 17)
    expected = environment_vectors(table, frames)[:, 0, :, 0, 0]
    assert expected.max() > 2.0 * expected.min()
    assert np.abs(seen[inside] - expected).mean() < 0.02 * expected.mean()


@pytest.mark.parametrize("engine", NODE_ENGINES)
def test_frames_turn_with_the_world(engine: str) -> None:
    """By drivers alone: no node changes when the world's rotation does."""
    with new_scene((2, 2)) as scene:
        world = new_world()
        mapping = world.node_tree.nodes["Mapping"]
        material = bpy.data.materials.new("Turned")
        if material.node_tree is None:
            material.use_nodes = True
        material.node_tree.nodes.clear()
        g = Graph(material.node_tree)
        direction = np.array([0.2, -0.5, 0.7])
        (axis,) = turned(g, [g.combine(*direction)], world, mapping)
        shade = g.node("ShaderNodeEmission", axis * 0.5 + (1.0, 1.0, 1.0))
        g.node("ShaderNodeOutputMaterial", g.wire(shade))
        add_mesh(scene, "plane", material)
        add_camera(scene, (0.0, 0.0), 1.0)
        set_engine(scene, engine, 1)
        for rotation in (ROTATION, (-1.0, 0.2, 2.5)):
            mapping.inputs["Rotation"].default_value = rotation
            expected = rotation_of(mapping) @ direction * 0.5 + 1.0
            np.testing.assert_allclose(render_pixels(scene)[0, 0], expected, atol=2e-3)


def test_frames_follow_an_edit_at_once() -> None:
    world = new_world()
    mapping = world.node_tree.nodes["Mapping"]
    material = bpy.data.materials.new("Turned")
    if material.node_tree is None:
        material.use_nodes = True
    g = Graph(material.node_tree)
    (axis,) = turned(g, [g.combine(1.0, 0.0)], world, mapping)
    mesh = bpy.data.meshes.new("Turned")
    mesh.materials.append(material)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Turned", mesh))
    bpy.context.scene.world = world
    for angle in (0.5, -1.0):
        mapping.inputs["Rotation"].default_value = (0.0, 0.0, angle)
        assert follow_world(world, mapping, axis.socket.node)
        bpy.context.view_layer.update()
        assert axis.socket.node.inputs["Rotation"].default_value[2] == pytest.approx(angle)
        assert not follow_world(world, mapping, axis.socket.node)


def _diffuser(size: int = 64) -> Tables:
    """Tables of a white diffuser: one light row, the cosine."""
    cosine = np.maximum(texel_directions(size)[..., 2], 0.0)
    index = np.zeros((1, size, size), np.uint32)
    return Tables(
        core=quads(np.ones((1, 1, 1, 1, 2, 2, 1)))[..., 0, :],
        light=quads(np.tile(cosine[..., None], (1, 3, 1, 1, 1, 1, 1)))[..., 0, :],
        view=quads(np.ones((1, 1, 1, size, size, 1)))[..., 0, :],
        light_index=index,
        view_index=index,
    )
