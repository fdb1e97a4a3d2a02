"""The node group that says which level of a texture a pixel should read.

Nacre Level   Texels -> Level

Shader nodes have no derivatives along the screen, but the Bump node makes some: the normal that it
returns tells the gradient of any height along the surface, by metre. Of the texture and of the
window's coordinates these are how much of the texture a step along the window covers. How long a
pixel's step is shows in the gradient of a square, (w + d)^2 - w^2 = d (2 w + d), since the node
takes differences. So the level needs neither camera nor resolution, and holds in any viewport.
"""

from __future__ import annotations

import bpy

from .graph import Graph, Wire

NAME = "Nacre Level"
_STEPS = 16.0
"""Pixels that differences are taken over: the square's rounding is then 1/1000 of a pixel."""
_FAR = 64.0
"""More levels than any texture has."""


def level_group() -> bpy.types.ShaderNodeTree:
    """The group, made at first use: texture coordinates in texels that do not wrap -> the base-2
    logarithm of the longer side of a pixel's footprint in texels, which may be negative."""
    if NAME in bpy.data.node_groups:
        return bpy.data.node_groups[NAME]
    tree = bpy.data.node_groups.new(NAME, "ShaderNodeTree")
    socket = tree.interface.new_socket("Texels", in_out="INPUT", socket_type="NodeSocketVector")
    socket.description = "Texture coordinates in texels, which go on where the texture repeats"
    output = tree.interface.new_socket("Level", in_out="OUTPUT", socket_type="NodeSocketFloat")
    output.description = "How often the texture should be halved for this pixel"
    g = Graph(tree)
    texels = g.separate(g.wire(g.node("NodeGroupInput")))[:2]
    window = g.separate(g.wire(g.node("ShaderNodeTexCoord"), "Window"))[:2]
    normal = g.wire(g.node("ShaderNodeNewGeometry"), "Normal")
    along = [_gradient(g, normal, part) for part in window]
    pixels = [_step(g, normal, *pair) for pair in zip(window, along, strict=True)]
    # Steps along the surface, with the area of the window's gradients still to be divided by.
    steps = [g.cross(along[1], normal) * pixels[0], g.cross(normal, along[0]) * pixels[1]]
    area = g.dot(g.cross(*along), normal)
    gradients = [_gradient(g, normal, part) for part in texels]
    squares = []
    for step in steps:
        u, v = (g.dot(gradient, step) for gradient in gradients)
        squares.append(g.math("MULTIPLY_ADD", u, u, v * v))
    longer = g.math("MAXIMUM", *squares) / g.math("MAXIMUM", area * area, 1e-30)
    logarithm = g.math("LOGARITHM", g.math("MAXIMUM", longer, 1e-12), 2.0)
    # A ray to a light has no pixel; what Cycles takes for its gradients there means nothing.
    to_light = g.wire(g.node("ShaderNodeLightPath"), "Is Shadow Ray")
    g.node("NodeGroupOutput", g.math("MULTIPLY_ADD", to_light, -_FAR, logarithm * 0.5))
    return tree


def _gradient(g: Graph, normal: Wire, height: Wire) -> Wire:
    bump = g.node("ShaderNodeBump")
    bump.inputs["Strength"].default_value = bump.inputs["Distance"].default_value = 1.0
    bump.inputs["Filter Width"].default_value = _STEPS
    g.connect(height, bump.inputs["Height"])
    bent = g.wire(bump)
    slope = g.math("MAXIMUM", g.dot(bent, normal), 1e-12)
    return normal - g.operate("MULTIPLY", bent, g.operate("DIVIDE", 1.0, slope))


def _step(g: Graph, normal: Wire, coordinate: Wire, gradient: Wire) -> Wire:
    """The pixel's step of a window coordinate."""
    square = _gradient(g, normal, coordinate * coordinate)
    length = g.math("MAXIMUM", g.dot(gradient, gradient), 1e-30)
    ratio = g.dot(gradient, square) / length
    return (ratio - coordinate * 2.0) * (1.0 / _STEPS)
