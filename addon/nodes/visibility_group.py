"""The node group that asks EEVEE how much of a light arrives: shadows, light linking, its reach.

Nacre Visibility   Direction, Radiance, Distance, Across, Up, Highlight -> Visible

A sharp white Glossy BSDF whose normal lies half way between the view and one light mirrors that
light alone to the viewer. Shader to RGB has its radiance with shadows; without them it is known,
and the ratio is the light's visibility, whatever other lights and the world add around it.
"""

from __future__ import annotations

import bpy

from .graph import Graph
from .light_group import drive, property_of

NAME = "Nacre Visibility"
ROUGHNESS = 0.2
"""Of the lobe: lights 20 degrees apart leave 1/400 of theirs in each other's; a sun of one degree
takes 1/75 from its peak, which the group accounts for."""

_GAIN = 1.01  # EEVEE's fit of the lobe is up to 1 % below GGX; what is lit shall read 1
_SOCKETS = (
    ("Direction", "Vector", "Unit direction to the light's middle, in the world"),
    ("Radiance", "Color", "Of a white diffuser lit head-on, without shadows"),
    ("Distance", "Float", "To the light in metres; 1 for suns"),
    ("Across", "Float", "Half the light's width as that of an ellipse, in metres at this distance"),
    ("Up", "Float", "Half its height"),
    ("Highlight", "Float", "How much stronger EEVEE makes the light in reflections"),
)


def visibility_group() -> bpy.types.ShaderNodeTree:
    """The group, made at first use: a light -> its part that reaches the point, 0 to 1, in EEVEE.

    1 in Cycles, which has no Shader to RGB, and for lights that EEVEE leaves out of reflections.
    """
    if NAME in bpy.data.node_groups:
        return bpy.data.node_groups[NAME]
    tree = bpy.data.node_groups.new(NAME, "ShaderNodeTree")
    for label, kind, tip in _SOCKETS:
        socket = tree.interface.new_socket(label, in_out="INPUT", socket_type=f"NodeSocket{kind}")
        socket.description = tip
    output = tree.interface.new_socket("Visible", in_out="OUTPUT", socket_type="NodeSocketFloat")
    output.description = "Part of the light that reaches the point"

    g = Graph(tree)
    inputs = g.node("NodeGroupInput")
    direction, radiance, distance, across, up, highlight = (
        g.wire(inputs, label) for label, *_ in _SOCKETS
    )
    view = g.wire(g.node("ShaderNodeNewGeometry"), "Incoming")
    half = g.normalize(view + direction)
    lobe = g.node("ShaderNodeBsdfAnisotropic", distribution="GGX")
    lobe.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    lobe.inputs["Roughness"].default_value = ROUGHNESS
    g.connect(half, lobe.inputs["Normal"])
    seen = g.dot(g.wire(g.node("ShaderNodeShaderToRGB", g.wire(lobe))), (1.0, 1.0, 1.0))

    # The peak of GGX is 1 / (4 alpha^2 cos); a light of some size averages over its neighbourhood.
    # In the plane of view and light the lobe is as much wider as its peak is higher (both 1 / cos),
    # so that the integral of a linearly transformed cosine (Heitz et al. 2016) has one width.
    width = g.math("MAXIMUM", g.dot(half, view), 1e-3) * (4.0 * ROUGHNESS**4)
    across, up = across / distance, up / distance
    spread = g.math("SQRT", (across * across + width) * (up * up + width))
    strength = g.dot(radiance, (1.0, 1.0, 1.0)) * highlight
    lit = strength * (across * up + 1.0) / spread
    ratio = g.math("MINIMUM", seen * _GAIN / g.math("MAXIMUM", lit, 1e-9), 1.0)

    # Cycles gives 0 for any Shader to RGB.
    white = g.node("ShaderNodeShaderToRGB", g.wire(g.node("ShaderNodeEmission")))
    asked = g.math("GREATER_THAN", g.dot(g.wire(white), (1.0, 1.0, 1.0)), 1.5)
    asked = asked * g.math("GREATER_THAN", lit, 1e-9)
    g.node("NodeGroupOutput", g.math("MULTIPLY_ADD", ratio - 1.0, asked, 1.0))
    return tree


def drive_visibility(node: bpy.types.ShaderNodeGroup, light: bpy.types.Object) -> None:
    """Drive what a new visibility node has to know of a light object besides its radiance."""
    names = {
        "a": "angle",
        "r": "shadow_soft_size",
        "x": "size",
        "y": "size_y",
        "k": "shape",
        "t": "type",
    }
    found = {key: property_of(light, f"data.{name}") for key, name in names.items()}
    # Suns (1) have an angle, areas (4) are squares, rectangles (1), disks (4) or ellipses (5). A
    # rectangle's half side times sqrt(4 / 3) spreads light as far as an ellipse's half axis.
    for label, size in (("Across", "x"), ("Up", "(y if k == 1 or k == 5 else x)")):
        area = f"{size} * (0.5 if k > 3 else 0.57735)"
        expression = f"tan(a / 2) if t == 1 else {area} if t == 4 else r"
        drive(node.inputs[label], -1, expression, **found)
    factor = property_of(light, "data.specular_factor")
    drive(node.inputs["Highlight"], -1, "v", v=factor)
