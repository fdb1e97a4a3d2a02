"""The tangent frame against vectors worked out by hand, on turned and mirrored planes."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from mathutils import Euler

from addon.nodes.frame_group import frame_group
from addon.nodes.graph import Graph
from addon.render.engines import NODE_ENGINES, render_pixels, set_engine
from addon.render.stage import add_camera, add_mesh, new_scene


@pytest.mark.parametrize("engine", NODE_ENGINES)
@pytest.mark.parametrize("mirrored", [False, True])
def test_the_view_in_the_tangent_frame_and_the_frame(engine: str, mirrored: bool) -> None:
    turn = Euler((0.35, -0.2, 0.7)).to_matrix()
    with new_scene((16, 16)) as scene:
        material = bpy.data.materials.new("Frame")
        if material.node_tree is None:
            material.use_nodes = True
        material.node_tree.nodes.clear()
        g = Graph(material.node_tree)
        node = g.node("ShaderNodeGroup", node_tree=frame_group())
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
        towards = camera.matrix_world.to_3x3().col[2]
        tangent, bitangent, normal = turn.col
        if mirrored:
            tangent = -tangent
        expected = [towards.dot(axis) for axis in (tangent, bitangent, normal)]
        np.testing.assert_allclose(view, expected, atol=2e-3)
        for name, axis in (("Tangent", tangent), ("Bitangent", bitangent), ("Normal", normal)):
            g.connect(g.wire(node, name) * 0.5 + (0.5, 0.5, 0.5), emission.inputs[0])
            np.testing.assert_allclose(render_pixels(scene)[8, 8] * 2.0 - 1.0, axis, atol=2e-3)
