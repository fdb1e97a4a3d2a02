"""The node group that has the tangent frame of a UV map."""

from __future__ import annotations

import bpy

from .graph import Graph

NAME = "Nacre Frame"


def frame_group() -> bpy.types.ShaderNodeTree:
    """The group, made at first use: View in the tangent frame, and the frame in the world.

    x is the tangent along +u, z the shading normal and y completes them on the side of +v, so that
    mirrored islands show the material mirrored as their texture is.
    """
    if NAME in bpy.data.node_groups:
        return bpy.data.node_groups[NAME]
    tree = bpy.data.node_groups.new(NAME, "ShaderNodeTree")
    for label, tip in (
        ("View", "Unit direction to the viewer: x tangent, y bitangent, z normal"),
        ("Tangent", "Unit vector along +u, in the world"),
        ("Bitangent", "Unit vector on the side of +v, in the world"),
        ("Normal", "Unit shading normal, in the world"),
    ):
        socket = tree.interface.new_socket(label, in_out="OUTPUT", socket_type="NodeSocketVector")
        socket.description = tip
    g = Graph(tree)
    geometry = g.node("ShaderNodeNewGeometry")
    normal, view = g.wire(geometry, "Normal"), g.wire(geometry, "Incoming")
    along_u = g.wire(g.node("ShaderNodeTangent", direction_type="UV_MAP"))
    # A normal map's green axis is the bitangent with the sign that mirroring gives it.
    green = g.node("ShaderNodeNormalMap", 1.0, (0.5, 1.0, 0.5, 1.0), space="TANGENT")
    along_v = g.wire(green)

    tangent = g.normalize(along_u - normal * g.dot(normal, along_u))
    upright = g.cross(normal, tangent)
    bitangent = upright * g.math("SIGN", g.dot(upright, along_v))
    frame = tangent, bitangent, normal
    g.node("NodeGroupOutput", g.combine(*(g.dot(view, axis) for axis in frame)), *frame)
    return tree
