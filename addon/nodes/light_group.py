"""The node group that turns a light object's properties into direction and radiance, and the
drivers that keep them in step with the object without script permission."""

from __future__ import annotations

from math import pi
from typing import Any

import bpy

from .graph import Graph, Operand, Wire

NAME = "Nacre Light"
# Blender's own numbers, which a driver reads.
KINDS = {"POINT": 0.0, "SUN": 1.0, "SPOT": 2.0, "AREA": 4.0}
SOCKETS: tuple[tuple[str, str, Any, str], ...] = (
    ("Kind", "Float", KINDS["SUN"], "Point 0, sun 1, spot 2, area 4"),
    ("Location", "Vector", (0.0, 0.0, 0.0), "World position in metres"),
    ("Rotation W", "Float", 1.0, "World rotation, real part of the quaternion"),
    ("Rotation", "Vector", (0.0, 0.0, 0.0), "World rotation, imaginary part of the quaternion"),
    ("Colour", "Color", (1.0, 1.0, 1.0, 1.0), "Linear colour with temperature"),
    ("Strength", "Float", pi, "Sun: irradiance in W/m2; others: power in W"),
    ("Spot Size", "Float", pi / 4, "Full angle of the cone"),
    ("Spot Blend", "Float", 0.15, "Softness of the cone's edge, 0 to 1"),
    ("Offset", "Vector", (0.0, 0.0, 0.0), "Area: this sample's place, in metres from the middle"),
)
AREA_SAMPLES = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))
"""Where an area light is sampled, in parts of its width and height: the middles of its quarters."""


def light_group() -> bpy.types.ShaderNodeTree:
    """The group, made at first use: a light's properties -> Direction (world), Radiance, Distance.

    Radiance is that of a white perfect diffuser lit head-on at the shading point; suns are at a
    distance of 1.
    """
    if NAME in bpy.data.node_groups:
        return bpy.data.node_groups[NAME]
    tree = bpy.data.node_groups.new(NAME, "ShaderNodeTree")
    for label, kind, value, tip in SOCKETS:
        socket = tree.interface.new_socket(label, in_out="INPUT", socket_type=f"NodeSocket{kind}")
        socket.default_value, socket.description = value, tip
    tree.interface.new_socket("Direction", in_out="OUTPUT", socket_type="NodeSocketVector")
    tree.interface.new_socket("Radiance", in_out="OUTPUT", socket_type="NodeSocketColor")
    tree.interface.new_socket("Distance", in_out="OUTPUT", socket_type="NodeSocketFloat")

    g = Graph(tree)
    inputs = g.node("NodeGroupInput")
    kind, location, w, xyz, colour, strength, spot_size, spot_blend, offset = (
        g.wire(inputs, label) for label, *_ in SOCKETS
    )
    is_sun, is_spot, is_area = (
        g.math("COMPARE", kind, KINDS[name], 0.5) for name in ("SUN", "SPOT", "AREA")
    )

    def turned(vector: Operand) -> Wire:
        """A vector of the light's own axes in the world: v + 2 q x (q x v + w v)."""
        return vector + g.cross(xyz, g.cross(xyz, vector) + vector * w) * 2.0

    # The light's own +z axis points away from where it shines.
    axis = turned(g.combine(0.0, 0.0, 1.0))
    position = g.wire(g.node("ShaderNodeNewGeometry"), "Position")
    towards = location + turned(offset) - position
    square = g.math("MAXIMUM", g.dot(towards, towards), 1e-12)
    direction = axis * is_sun + g.normalize(towards) * g.operate("SUBTRACT", 1.0, is_sun)

    # Power spreads over the sphere, then pi again from irradiance to a diffuser's radiance.
    falloff = g.operate("DIVIDE", 1.0 / (4.0 * pi**2), square)
    sun, other = is_sun * (1.0 / pi), g.operate("SUBTRACT", 1.0, is_sun) * falloff
    cone = _cone(g, g.dot(direction, axis), spot_size, spot_blend)
    inside = (cone - 1.0) * is_spot + 1.0
    # An area sends its power to one side, a share from each sample, and by the cosine.
    share = g.math("MAXIMUM", g.dot(direction, axis), 0.0) * (4.0 / len(AREA_SAMPLES))
    flat = (share - 1.0) * is_area + 1.0
    radiance = colour * ((sun + other) * inside * flat * strength)
    distance = (g.math("SQRT", square) - 1.0) * g.operate("SUBTRACT", 1.0, is_sun) + 1.0
    g.node("NodeGroupOutput", direction, radiance, distance)
    return tree


def _cone(g: Graph, cosine: Wire, size: Wire, blend: Wire) -> Wire:
    """Cycles' and EEVEE's smooth step from the cone's edge inwards."""
    edge = g.math("COSINE", size * 0.5)
    width = g.math("MAXIMUM", g.operate("SUBTRACT", 1.0, edge) * blend, 1e-4)
    step = g.node("ShaderNodeMath", (cosine - edge) / width, operation="ADD", use_clamp=True)
    t = g.wire(step)
    step.inputs[1].default_value = 0.0
    return t * t * g.operate("SUBTRACT", 3.0, t * 2.0)


def samples_of(light: bpy.types.Object) -> tuple[tuple[float, float], ...]:
    """Where a light is sampled, in parts of its size; one place unless it is an area."""
    return AREA_SAMPLES if light.data.type == "AREA" else ((0.0, 0.0),)


def drive_light(
    node: bpy.types.ShaderNodeGroup,
    light: bpy.types.Object,
    sample: tuple[float, float] = (0.0, 0.0),
) -> None:
    """Drive a new light group node's inputs from a light object, or from one sample of an area."""
    inputs = node.inputs
    drive(inputs["Kind"], -1, "v", v=property_of(light, "data.type"))
    for index, axis in enumerate("XYZ"):
        drive(inputs["Location"], index, "v", v=_transform(light, f"LOC_{axis}"))
        drive(inputs["Rotation"], index, "v", v=_transform(light, f"ROT_{axis}"))
        drive(
            inputs["Colour"],
            index,
            "c * (1 + u * (t - 1))",
            c=property_of(light, f"data.color[{index}]"),
            u=property_of(light, "data.use_temperature"),
            t=property_of(light, f"data.temperature_color[{index}]"),
        )
    drive(inputs["Rotation W"], -1, "v", v=_transform(light, "ROT_W"))
    drive(
        inputs["Strength"],
        -1,
        "e * pow(2, x)",
        e=property_of(light, "data.energy"),
        x=property_of(light, "data.exposure"),
    )
    for label, path in (("Spot Size", "data.spot_size"), ("Spot Blend", "data.spot_blend")):
        drive(inputs[label], -1, "v", v=property_of(light, path))
    if any(sample):
        width, height, shape = (
            property_of(light, f"data.{name}") for name in ("size", "size_y", "shape")
        )
        drive(inputs["Offset"], 0, f"{sample[0]} * x", x=width)
        # Rectangles (1) and ellipses (5) have a height of their own.
        height_of = f"{sample[1]} * (y if k == 1 or k == 5 else x)"
        drive(inputs["Offset"], 1, height_of, x=width, y=height, k=shape)


def property_of(light: bpy.types.Object, path: str) -> dict[str, object]:
    """A property as a driver's variable, 0 where this kind of light lacks it."""
    # Only a spot has the cone's properties, and a light may become one later.
    return {"id": light, "data_path": path, "use_fallback_value": True, "fallback_value": 0.0}


def _transform(light: bpy.types.Object, channel: str) -> dict[str, object]:
    return {
        "id": light,
        "transform_type": channel,
        "transform_space": "WORLD_SPACE",
        "rotation_mode": "QUATERNION",
    }


def drive(
    socket: bpy.types.NodeSocket, index: int, expression: str, **variables: dict[str, object]
) -> None:
    """One driver on a socket's value; the expression must be of the simple kind, which needs no
    permission to run scripts."""
    driver = socket.driver_add("default_value", index).driver
    for name, settings in variables.items():
        variable = driver.variables.new()
        variable.name = name
        variable.type = "TRANSFORMS" if "transform_type" in settings else "SINGLE_PROP"
        for key, value in settings.items():
            setattr(variable.targets[0], key, value)
    driver.expression = expression
