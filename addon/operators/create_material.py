"""A model to a material on the selected objects."""

from pathlib import Path
from typing import Any

import bpy

from ..jobs import JobOperator, Progress, Work
from .ready import is_ready


class NACRE_OT_create_material(JobOperator, bpy.types.Operator):
    """Make a material that shows the model, on the selected meshes"""

    bl_idname = "nacre.create_material"
    bl_label = "Create Material"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not context.scene.nacre.model:
            cls.poll_message_set("Compress a dataset or choose a model first")
            return False
        return is_ready(cls)

    def prepare(self, context: bpy.types.Context) -> Work:
        from ..models.any_model import load_first
        from ..models.sparse.files import promised_quality
        from ..nodes.node_tables import build_node_tables

        path = Path(bpy.path.abspath(context.scene.nacre.model))
        self._name = path.stem

        def work(progress: Progress) -> Any:
            progress(0.0, "Reading the model")
            model = load_first(path)
            return model, promised_quality(path), build_node_tables(model, progress=progress)

        return work

    def finish(self, context: bpy.types.Context, result: Any) -> None:
        from ..models.any_model import quality_of_model
        from ..nodes.light_set import shining
        from ..nodes.material import material_from_tables
        from ..nodes.shown import what_is_shown
        from ..quality_slider import set_quality

        chosen = context.scene.nacre
        owner = chosen.lights or context.scene
        model, best, tables = result
        material = material_from_tables(tables, self._name, owner)
        material.nacre.lights = chosen.lights
        material.nacre.model = chosen.model
        material.nacre.patch_size = model.dataset.get("patch_size") or (0.0, 0.0)
        # What a sparse model has of a higher quality follows.
        set_quality(material, quality_of_model(model), best, best)
        meshes = _target_meshes(context)
        for item in meshes:
            item.active_material = material
        note = what_is_shown(context.scene, material)
        _report(self, material, meshes, bool(shining(owner)), note)


def _target_meshes(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected meshes that may be changed."""
    return [
        item
        for item in context.view_layer.objects.selected
        if item.type == "MESH" and item.is_editable and item.data.is_editable
    ]


def _report(
    operator: bpy.types.Operator,
    material: bpy.types.Material,
    meshes: list[bpy.types.Object],
    is_lit: bool,
    note: str,
) -> None:
    """Say what came of it, and what is still missing for a picture."""
    flat = [item.name for item in meshes if not item.data.uv_layers]
    if flat:
        names = ", ".join(flat)
        operator.report({"WARNING"}, f"No UV map on {names}: unwrap it to see the material")
    elif not is_lit:
        operator.report({"WARNING"}, "No sun, point, spot or area lights it: add one")
    elif note:
        operator.report({"WARNING"}, note)
    elif meshes:
        names = ", ".join(item.name for item in meshes)
        operator.report({"INFO"}, f"Made the material {material.name} on {names}")
    else:
        operator.report({"INFO"}, f"Made the material {material.name}; no mesh is selected")
