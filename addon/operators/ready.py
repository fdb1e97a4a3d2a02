"""What every step needs before it can start."""

import bpy

from .. import jobs, wheels


def is_ready(operator: type[bpy.types.Operator]) -> bool:
    """Whether the compiled packages are there and no other job runs; tells the user if not."""
    problem = wheels.missing()
    if problem is None and jobs.running() is not None:
        problem = "Wait for the work under way, or cancel it"
    if problem is not None:
        operator.poll_message_set(problem)
    return problem is None


def has_model(operator: type[bpy.types.Operator], context: bpy.types.Context) -> bool:
    """Whether the active material shows a model; tells the user if not."""
    from ..nodes.material import is_nacre_material

    found = context.object is not None and is_nacre_material(context.object.active_material)
    if not found:
        operator.poll_message_set("Select an object whose material shows a model")
    return found
