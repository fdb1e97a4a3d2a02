"""A small way to write shader node trees as arithmetic.

    g = Graph(tree)
    u, v = g.separate(uv)[:2]
    g.combine(u * 2.0 + 0.5, v, 0.0)

Every operator adds one node and links it; nothing is simplified behind the writer's back, except
that constants stay unlinked socket values.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy

Operand = "Wire | float | tuple[float, float, float]"


@dataclass(frozen=True)
class Wire:
    """An output socket that takes part in arithmetic; scalar or vector by its socket's type."""

    graph: Graph
    socket: bpy.types.NodeSocket

    @property
    def is_vector(self) -> bool:
        return self.socket.type in {"VECTOR", "RGBA"}

    def __add__(self, other: Operand) -> Wire:
        return self.graph.operate("ADD", self, other)

    def __sub__(self, other: Operand) -> Wire:
        return self.graph.operate("SUBTRACT", self, other)

    def __rsub__(self, other: Operand) -> Wire:
        return self.graph.operate("SUBTRACT", other, self)

    def __mul__(self, other: Operand) -> Wire:
        return self.graph.operate("MULTIPLY", self, other)

    def __truediv__(self, other: Operand) -> Wire:
        return self.graph.operate("DIVIDE", self, other)

    __radd__, __rmul__ = __add__, __mul__


class Graph:
    """Writes nodes into one tree, in a row from left to right.

    Wires of other trees become inputs of this one, a group's, and are listed in `outside` in the
    order of these inputs.
    """

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree
        self.outside: list[Wire] = []
        self._inside: dict[bpy.types.NodeSocket, Wire] = {}

    def node(self, kind: str, *operands: Operand, **properties: object) -> bpy.types.Node:
        """A node of a type with its properties set and its first inputs connected."""
        node = self.tree.nodes.new(kind)
        for name, value in properties.items():
            setattr(node, name, value)
        for socket, operand in zip(node.inputs, operands, strict=False):
            self.connect(operand, socket)
        count = len(self.tree.nodes)
        node.location = (count // 16 * 200.0, -(count % 16) * 60.0)
        node.hide = True
        return node

    def connect(self, operand: Operand, socket: bpy.types.NodeSocket) -> None:
        """Link a wire to a socket, or set its value to a constant."""
        if isinstance(operand, Wire):
            self.tree.links.new(self._here(operand).socket, socket)
        else:
            socket.default_value = operand

    def group_input(self, label: str, kind: str) -> Wire:
        """A new input of the group, Float or Vector."""
        self.tree.interface.new_socket(label, in_out="INPUT", socket_type=f"NodeSocket{kind}")
        node = self.node("NodeGroupInput")
        return Wire(self, node.outputs[-2])  # the last one is for new sockets

    def _here(self, operand: Wire) -> Wire:
        if operand.graph is self or operand.socket.id_data == self.tree:
            return operand
        if operand.socket not in self._inside:
            kind = "Vector" if operand.is_vector else "Float"
            self._inside[operand.socket] = self.group_input(operand.socket.name, kind)
            self.outside.append(operand)
        return self._inside[operand.socket]

    def wire(self, node: bpy.types.Node, output: int | str = 0) -> Wire:
        return Wire(self, node.outputs[output])

    def operate(self, operation: str, *operands: Operand) -> Wire:
        """One Math or Vector Math node, vector when any operand is; scalars spread over vectors."""
        if not any(_is_vector(o) for o in operands):
            return self.math(operation, *operands)
        if operation == "MULTIPLY":
            scalars = [o for o in operands if not _is_vector(o)]
            if len(scalars) == 1:
                (vectors,) = [o for o in operands if o is not scalars[0]]
                node = self.node("ShaderNodeVectorMath", operation="SCALE")
                self.connect(vectors, node.inputs[0])
                self.connect(scalars[0], node.inputs["Scale"])
                return self.wire(node)
        operands = tuple((o, o, o) if isinstance(o, (int, float)) else o for o in operands)
        return self.wire(self.node("ShaderNodeVectorMath", *operands, operation=operation))

    def math(self, operation: str, *operands: Operand) -> Wire:
        """A Math node by its operation's name."""
        return self.wire(self.node("ShaderNodeMath", *operands, operation=operation))

    def dot(self, a: Operand, b: Operand) -> Wire:
        node = self.node("ShaderNodeVectorMath", a, b, operation="DOT_PRODUCT")
        return self.wire(node, "Value")

    def cross(self, a: Operand, b: Operand) -> Wire:
        return self.wire(self.node("ShaderNodeVectorMath", a, b, operation="CROSS_PRODUCT"))

    def normalize(self, a: Operand) -> Wire:
        return self.wire(self.node("ShaderNodeVectorMath", a, operation="NORMALIZE"))

    def length(self, a: Operand) -> Wire:
        return self.wire(self.node("ShaderNodeVectorMath", a, operation="LENGTH"), "Value")

    def separate(self, a: Operand) -> tuple[Wire, Wire, Wire]:
        node = self.node("ShaderNodeSeparateXYZ", a)
        return self.wire(node, 0), self.wire(node, 1), self.wire(node, 2)

    def combine(self, x: Operand, y: Operand, z: Operand = 0.0) -> Wire:
        return self.wire(self.node("ShaderNodeCombineXYZ", x, y, z))


def _is_vector(operand: Operand) -> bool:
    return isinstance(operand, tuple) or (isinstance(operand, Wire) and operand.is_vector)
