"""The node group that turns world directions into the tangent frame of a UV map."""

from __future__ import annotations

import bpy

from .graph import Graph, Wire

NAME = "Nacre Frame"


def frame_group() -> bpy.types.ShaderNodeTree:
    """The group, made at first use: Light (world) -> View and Light in the tangent frame.

    x is the tangent along +u, z the shading normal and y completes them on the side of +v, so that
    mirrored islands show the material mirrored as their texture is.
    """
    if NAME in bpy.data.node_groups:
        return bpy.data.node_groups[NAME]
    tree = bpy.data.node_groups.new(NAME, "ShaderNodeTree")
    for label, in_out, tip in (
        ("Light", "INPUT", "Unit direction to the light in the world"),
        ("View", "OUTPUT", "Unit direction to the viewer: x tangent, y bitangent, z normal"),
        ("Light", "OUTPUT", "Unit direction to the light: x tangent, y bitangent, z normal"),
    ):
        socket = tree.interface.new_socket(label, in_out=in_out, socket_type="NodeSocketVector")
        socket.description = tip
    g = Graph(tree)
    light = g.wire(g.node("NodeGroupInput"), "Light")
    geometry = g.node("ShaderNodeNewGeometry")
    normal, view = g.wire(geometry, "Normal"), g.wire(geometry, "Incoming")
    along_u = g.wire(g.node("ShaderNodeTangent", direction_type="UV_MAP"))
    # A normal map's green axis is the bitangent with the sign that mirroring gives it.
    green = g.node("ShaderNodeNormalMap", 1.0, (0.5, 1.0, 0.5, 1.0), space="TANGENT")
    along_v = g.wire(green)

    tangent = g.normalize(along_u - normal * g.dot(normal, along_u))
    upright = g.cross(normal, tangent)
    bitangent = upright * g.math("SIGN", g.dot(upright, along_v))

    def turned(direction: Wire) -> Wire:
        return g.combine(*(g.dot(direction, axis) for axis in (tangent, bitangent, normal)))

    g.node("NodeGroupOutput", turned(view), turned(light))
    return tree
