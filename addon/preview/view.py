"""What a camera or a light looks at."""

from __future__ import annotations

from dataclasses import dataclass

from mathutils import Matrix


@dataclass(frozen=True)
class View:
    """World to clip space, and where the viewer is: a point with 1, or a direction with 0, as
    homogeneous coordinates of the world."""

    projection: Matrix
    viewer: tuple[float, float, float, float]

    @classmethod
    def of(cls, world_to_view: Matrix, window: Matrix) -> View:
        """From Blender's view and window matrices."""
        back = world_to_view.inverted()
        perspective = window[3][3] == 0.0
        viewer = back.translation if perspective else back.col[2].xyz
        return cls(window @ world_to_view, (*viewer, 1.0 if perspective else 0.0))
