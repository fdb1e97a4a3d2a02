"""What the verbs that need Blender share."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..errors import NacreError
from .arguments import Progress

if TYPE_CHECKING:
    import bpy

    from ..models.any_model import Model


def need_blender() -> None:
    """Raise NacreError where there is no Blender."""
    try:
        import bpy  # noqa: F401
    except ImportError as error:
        raise NacreError(
            "this needs Blender: run `blender --command nacre ...`, or install the bpy wheel"
        ) from error


def build_material(model: Model, name: str, progress: Progress) -> bpy.types.Material:
    """A material that shows a model."""
    from ..nodes.material import material_from_tables
    from ..nodes.node_tables import build_node_tables

    return material_from_tables(build_node_tables(model, progress=progress), name)
