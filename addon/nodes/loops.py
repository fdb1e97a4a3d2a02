"""Loops in shader trees: repeat zones where Blender has them (5.0), else copies of a group.

EEVEE keeps a zone as a loop, so that a shader's size does not grow with its count; Cycles unrolls
it when it compiles. The body is written once for both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import bpy

from .graph import Graph, Operand, Wire

_LOOP = "nacre_loop"

Body = Callable[[Graph, "Wire | int", list[Wire]], Sequence["Wire | float"]]


def repeat(g: Graph, count: int, start: Sequence[Operand], body: Body) -> list[Wire]:
    """`body(graph, index, state)` for `count` rounds, each from what the last returned.

    The body writes into the graph it is given, and may use wires of `g` or of what is around it.
    The state is scalars where `start` has numbers, and vectors where it has tuples. A single round
    has the index 0, a number; else the index is a wire, which `choose` takes.
    """
    if count == 1:
        return list(body(g, 0, list(start)))  # type: ignore[arg-type]
    if has_zones():
        return _zone(g, count, start, body)
    return _copies(g, count, start, body)


def choose(g: Graph, index: Wire | int, values: Sequence[Operand]) -> Operand:
    """The value of this round; all scalars or all vectors."""
    if isinstance(index, int):
        return values[index]
    first, *others = values
    chosen: Operand = g.operate("MULTIPLY", g.math("COMPARE", index, 0.0, 0.5), first)
    for number, value in enumerate(others, 1):
        here = g.math("COMPARE", index, float(number), 0.5)
        chosen = g.operate("ADD", chosen, g.operate("MULTIPLY", here, value))
    return chosen


def clear(
    tree: bpy.types.ShaderNodeTree, keep: Callable[[bpy.types.Node], bool] = lambda _: False
) -> None:
    """Remove a tree's nodes but those to keep, and the groups that its loops were written into."""
    loops = {node.node_tree for node in tree.nodes if node.type == "GROUP" and node.node_tree}
    for node in list(tree.nodes):
        if not keep(node):
            tree.nodes.remove(node)
    for loop in loops:
        if _LOOP in loop:
            clear(loop)
            bpy.data.node_groups.remove(loop)


def has_zones() -> bool:
    """Whether shaders can loop here."""
    return bpy.app.version >= (5, 0)


def _zone(g: Graph, count: int, start: Sequence[Operand], body: Body) -> list[Wire]:
    first, last = (g.tree.nodes.new(f"GeometryNodeRepeat{end}") for end in ("Input", "Output"))
    first.pair_with_output(last)
    last.repeat_items.clear()
    for number, value in enumerate(start):
        last.repeat_items.new("VECTOR" if _is_vector(value) else "FLOAT", f"State {number}")
    # Unlinked: Cycles takes a count that it cannot see beforehand for none at all.
    first.inputs["Iterations"].default_value = count
    for value, socket in zip(start, first.inputs[1:], strict=False):
        g.connect(value, socket)
    index, *state = (Wire(g, socket) for socket in first.outputs[: len(start) + 1])
    for result, socket in zip(body(g, index, state), last.inputs, strict=False):
        g.connect(result, socket)
    return [Wire(g, socket) for socket in last.outputs[: len(start)]]


def _copies(g: Graph, count: int, start: Sequence[Operand], body: Body) -> list[Wire]:
    """The body as a group, with inputs for all that it uses from outside; one node a round."""
    tree = bpy.data.node_groups.new(f"{g.tree.name} Loop", "ShaderNodeTree")
    tree[_LOOP] = True
    inner = Graph(tree)
    index = inner.group_input("Index", "Float")
    kinds = ["Vector" if _is_vector(value) else "Float" for value in start]
    state = [inner.group_input(f"State {i}", kind) for i, kind in enumerate(kinds)]
    results = body(inner, index, state)
    for number, kind in enumerate(kinds):
        tree.interface.new_socket(
            f"State {number}", in_out="OUTPUT", socket_type=f"NodeSocket{kind}"
        )
    inner.node("NodeGroupOutput", *results)
    values: Sequence[Operand] = start
    for round_ in range(count):
        operands = [_after(g, float(round_), values[0]), *values, *inner.outside]
        node = g.node("ShaderNodeGroup", node_tree=tree)
        for operand, socket in zip(operands, node.inputs, strict=True):
            g.connect(operand, socket)
        values = [Wire(g, socket) for socket in node.outputs]
    return list(values)  # type: ignore[arg-type]


def _after(g: Graph, number: float, state: Operand) -> Operand:
    """The number once the state is known: Cycles reads textures as soon as it can, keeps at most
    255 live values, and would else hold those of all rounds at once."""
    if not isinstance(state, Wire):
        return number
    scalar = g.dot(state, (1.0, 1.0, 1.0)) if state.is_vector else state
    return g.math("MULTIPLY_ADD", scalar, 1e-30, number)


def _is_vector(operand: Operand) -> bool:
    return isinstance(operand, tuple) or (isinstance(operand, Wire) and operand.is_vector)
