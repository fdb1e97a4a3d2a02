"""The tangent frame against vectors worked out by hand, on turned and mirrored planes."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from mathutils import Euler, Vector

from addon.nodes.frame_group import frame_group
from addon.nodes.graph import Graph
from addon.render.engines import ENGINES, render_pixels, set_engine
from addon.render.stage import add_camera, add_mesh, new_scene


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("mirrored", [False, True])
def test_view_and_light_in_the_tangent_frame(engine: str, mirrored: bool) -> None:
    light = Vector((0.3, -0.5, 0.8)).normalized()
    turn = Euler((0.35, -0.2, 0.7)).to_matrix()
    with new_scene((16, 16)) as scene:
        material = bpy.data.materials.new("Frame")
        if material.node_tree is None:
            material.use_nodes = True
        material.node_tree.nodes.clear()
        g = Graph(material.node_tree)
        node = g.node("ShaderNodeGroup", tuple(light), node_tree=frame_group())
        colour = g.wire(node, "View") * 0.5 + (0.5, 0.5, 0.5)
        emission = g.node("ShaderNodeEmission", colour)
        g.node("ShaderNodeOutputMaterial", g.wire(emission))
        plane = add_mesh(scene, "plane", material)
        plane.rotation_euler = turn.to_euler()
        if mirrored:
            for corner in plane.data.uv_layers.active.uv:
                corner.vector[0] = 1.0 - corner.vector[0]
        camera = add_camera(scene, (25.0, 70.0), 0.3)
        set_engine(scene, engine, 1)
        view = render_pixels(scene)[8, 8] * 2.0 - 1.0
        colour.graph.connect(g.wire(node, "Light") * 0.5 + (0.5, 0.5, 0.5), emission.inputs[0])
        lit = render_pixels(scene)[8, 8] * 2.0 - 1.0
        towards = camera.matrix_world.to_3x3().col[2]
        tangent, bitangent, normal = turn.col
        if mirrored:
            tangent = -tangent
        for seen, direction in ((view, towards), (lit, light)):
            expected = [direction.dot(axis) for axis in (tangent, bitangent, normal)]
            np.testing.assert_allclose(seen, expected, atol=2e-3)
