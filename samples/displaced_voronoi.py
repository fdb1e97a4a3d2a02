"""Scales: a material with true displacement from a Voronoi texture that repeats after 2 cm.

`python samples/displaced_voronoi.py OUT.blend`, or `blender -b -P samples/displaced_voronoi.py --
OUT.blend`. Then measure the material "Scales" at a size of 0.02 m.
"""

import sys
from math import pi

import bpy

SIZE = 0.02
CELLS = 4.0  # along a side
HEIGHT = 0.0011


def build() -> bpy.types.Material:
    material = bpy.data.materials.new("Scales")
    if material.node_tree is None:  # before 5.0
        material.use_nodes = True
    material.displacement_method = "DISPLACEMENT"
    nodes, links = material.node_tree.nodes, material.node_tree.links
    voronoi = {
        feature: _voronoi(material.node_tree, feature) for feature in ("F1", "DISTANCE_TO_EDGE")
    }
    shader = nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = 0.28
    tint = nodes.new("ShaderNodeValToRGB")
    tint.color_ramp.elements[0].color = (0.02, 0.10, 0.11, 1)
    tint.color_ramp.elements[1].color = (0.75, 0.33, 0.08, 1)
    links.new(voronoi["F1"].outputs["Color"], tint.inputs["Fac"])
    links.new(tint.outputs["Color"], shader.inputs["Base Color"])
    # Domes with a groove between them.
    groove = nodes.new("ShaderNodeMapRange")
    groove.interpolation_type = "SMOOTHSTEP"
    groove.inputs["From Max"].default_value = 0.4
    links.new(voronoi["DISTANCE_TO_EDGE"].outputs["Distance"], groove.inputs["Value"])
    dome = nodes.new("ShaderNodeMath")
    dome.operation = "MULTIPLY_ADD"
    dome.inputs[1].default_value = -0.4
    links.new(voronoi["F1"].outputs["Distance"], dome.inputs[0])
    links.new(groove.outputs["Result"], dome.inputs[2])
    displace = nodes.new("ShaderNodeDisplacement")
    displace.inputs["Midlevel"].default_value = 0.5
    displace.inputs["Scale"].default_value = HEIGHT
    links.new(dome.outputs["Value"], displace.inputs["Height"])
    links.new(displace.outputs[0], nodes["Material Output"].inputs["Displacement"])
    return material


def _voronoi(tree: bpy.types.NodeTree, feature: str) -> bpy.types.Node:
    """A Voronoi texture on a flat torus in four dimensions, so that it repeats with the UV map."""
    nodes, links = tree.nodes, tree.links
    texture = nodes.new("ShaderNodeTexVoronoi")
    texture.voronoi_dimensions, texture.feature = "4D", feature
    texture.inputs["Scale"].default_value = 1.0
    texture.inputs["Randomness"].default_value = 0.9
    uv, split, join = (
        nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "SeparateXYZ", "CombineXYZ")
    )
    links.new(uv.outputs["UV"], split.inputs[0])
    ends = [*join.inputs, texture.inputs["W"]]
    for index, end in enumerate(ends):
        turn, circle, radius = (nodes.new("ShaderNodeMath") for _ in range(3))
        turn.operation, circle.operation, radius.operation = (
            "MULTIPLY",
            ("COSINE", "SINE")[index % 2],
            "MULTIPLY",
        )
        turn.inputs[1].default_value = 2 * pi
        radius.inputs[1].default_value = CELLS / (2 * pi)
        links.new(split.outputs[index // 2], turn.inputs[0])
        links.new(turn.outputs[0], circle.inputs[0])
        links.new(circle.outputs[0], radius.inputs[0])
        links.new(radius.outputs[0], end)
    links.new(join.outputs[0], texture.inputs["Vector"])
    return texture


if __name__ == "__main__":
    bpy.ops.wm.read_factory_settings(use_empty=True)
    build().use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=sys.argv[-1])
