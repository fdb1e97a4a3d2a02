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
