"""Scenes of their own: what was there before stays, what was made goes."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.errors import NacreError
from addon.render.blend_file import write_blend
from addon.render.engines import check_picture, render_pixels, render_to, set_engine
from addon.render.stage import add_camera, add_mesh, add_sun, new_scene


@pytest.fixture(autouse=True)
def factory_file() -> None:
    bpy.ops.wm.read_factory_settings(use_empty=False)


def _everything() -> set[str]:
    kinds = ("scenes", "objects", "meshes", "lights", "cameras", "worlds")
    return {f"{kind}/{item.name}" for kind in kinds for item in getattr(bpy.data, kind)}


@pytest.mark.parametrize("mesh", ["plane", "cloth", "sphere"])
def test_scene_leaves_no_trace(mesh: str) -> None:
    before = _everything()
    material = bpy.data.materials.new("Test")
    with new_scene((8, 8)) as scene:
        add_mesh(scene, mesh, material)
        add_camera(scene, (10.0, 20.0), 2.0)
        add_sun(scene, (30.0, 40.0))
    assert _everything() == before


def test_scene_leaves_no_trace_after_an_error() -> None:
    before = _everything()
    with pytest.raises(RuntimeError, match="stop"), new_scene((8, 8)) as scene:
        add_sun(scene, (30.0, 40.0))
        raise RuntimeError("stop")
    assert _everything() == before


@pytest.mark.parametrize("mesh", ["cloth", "sphere"])
def test_uv_frames_are_right_handed(mesh: str) -> None:
    """+u, +v and the normal that points out of the object agree, and no face is stretched flat."""
    with new_scene((8, 8)) as scene:
        item = add_mesh(scene, mesh, bpy.data.materials.new("Test"))
        layer = item.data.uv_layers.active.uv
        for face in list(item.data.polygons)[:: len(item.data.polygons) // 300]:
            if len(face.vertices) < 4:
                continue  # at a pole
            corners = [item.data.vertices[i].co for i in face.vertices[:3]]
            uv = [layer[i].vector for i in face.loop_indices[:3]]
            edges = np.array([corners[1] - corners[0], corners[2] - corners[0]])
            steps = np.array([uv[1] - uv[0], uv[2] - uv[0]])
            tangent, bitangent = np.linalg.solve(steps, edges)
            normal = np.cross(tangent, bitangent)
            outward = face.center if mesh == "sphere" else (0.0, 0.0, 1.0)
            assert np.dot(normal, outward) > 0.0
            assert np.dot(normal, face.normal) > 0.0


def test_mesh_file(tmp_path: Path) -> None:
    """A file without UVs is centred, scaled to 2 m and gets a projection; its import is tidy."""
    path = tmp_path / "box.obj"
    path.write_text("v 10 0 0\nv 14 0 0\nv 14 2 0\nv 10 2 0\nf 1 2 3 4\n", encoding="utf-8")
    before = _everything()
    with new_scene((8, 8)) as scene:
        item = add_mesh(scene, str(path), bpy.data.materials.new("Test"))
        points = np.array([vertex.co for vertex in item.data.vertices])
        np.testing.assert_allclose(np.ptp(points, axis=0).max(), 2.0, atol=1e-5)
        np.testing.assert_allclose(points.max(0) + points.min(0), 0.0, atol=1e-5)
        assert len(item.data.uv_layers) == 1
    assert _everything() == before


@pytest.mark.parametrize("name", ["no.obj", "no.txt", "cube"])
def test_wrong_mesh(name: str) -> None:
    with new_scene((8, 8)) as scene, pytest.raises(NacreError, match="expected one of plane"):
        add_mesh(scene, name, bpy.data.materials.new("Test"))


def test_wrong_pictures(tmp_path: Path) -> None:
    for path, engine in (("a.jpg", "eevee"), ("no/a.png", "cycles"), ("a.png", "luxcore")):
        with pytest.raises(NacreError) as caught:
            check_picture(tmp_path / path, engine)
        assert "\n" not in str(caught.value)


def test_sun_of_strength_pi_on_white_is_the_cosine() -> None:
    material = bpy.data.materials.new("White")
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (1, 1, 1, 1)
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(diffuse.outputs[0], output.inputs[0])
    with new_scene((8, 8)) as scene:
        scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
        add_mesh(scene, "plane", material)
        add_camera(scene, (0.0, 0.0), 0.5)
        add_sun(scene, (60.0, 123.0))
        set_engine(scene, "cycles", 4)
        np.testing.assert_allclose(render_pixels(scene), 0.5, rtol=1e-3)


def test_picture_that_cannot_be_written(tmp_path: Path) -> None:
    with new_scene((8, 8)) as scene:
        add_camera(scene, (0.0, 0.0), 0.5)
        set_engine(scene, "cycles", 1)
        (tmp_path / "file").touch()
        with pytest.raises((NacreError, RuntimeError)):
            render_to(scene, tmp_path / "file" / "a.png")


def test_blend_file_is_whole_or_absent(tmp_path: Path) -> None:
    material = bpy.data.materials.new("Test")
    with pytest.raises(NacreError, match="no such folder"):
        write_blend(tmp_path / "missing" / "a.blend", material)
    write_blend(tmp_path / "a.blend", material)
    assert [path.name for path in tmp_path.iterdir()] == ["a.blend"]
    with bpy.data.libraries.load(str(tmp_path / "a.blend"), assets_only=True) as (source, _):
        assert source.materials == ["Test"]
