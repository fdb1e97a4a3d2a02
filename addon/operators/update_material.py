"""A material brought up to date with the files of its models."""

from pathlib import Path
from typing import Any

import bpy

from ..errors import NacreError
from ..jobs import JobOperator, Progress, Work
from .ready import has_model, is_ready


class NACRE_OT_update_material(JobOperator, bpy.types.Operator):
    """Read the models of the active material again, and show them in place"""

    bl_idname = "nacre.update_material"
    bl_label = "Update Material"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return has_model(cls, context) and is_ready(cls)

    def prepare(self, context: bpy.types.Context) -> Work:
        from ..datasets.occlusion import MAPPINGS
        from ..models.any_model import load_any, quality_of_model
        from ..models.sparse.model import SparseBtf
        from ..nodes.kept_world import environment_for, kept_world
        from ..nodes.node_tables import build_node_tables
        from ..tables.any_tables import build_any_tables

        self._material = context.object.active_material
        files = self._material.nacre
        # The slider stays where it is, on a file that had one before.
        wanted = files.quality if files.file_quality else None
        self._shown = self._best = 0
        kept = kept_world(self._material.node_tree)
        paths = {
            part: Path(bpy.path.abspath(getattr(files, part)))
            for part in ("model", "blended", "occlusion", "final_model")
            if getattr(files, part)
        }

        def work(progress: Progress) -> Any:
            def share(number: int) -> Progress:
                return lambda f, text: progress((number + f) / len(paths), text)

            found = {}
            for number, (part, path) in enumerate(paths.items()):
                model = load_any(path)
                kind = "occlusion" if part == "occlusion" else "btf"
                if model.kind != kind:
                    raise NacreError(f"{path}: a model of {model.kind}; expected one of {kind}")
                if part == "model":
                    self._best = quality_of_model(model)
                    self._shown = min(wanted or self._best, self._best)
                    if isinstance(model, SparseBtf):
                        model = model.truncated(self._shown)
                if part == "blended" and not isinstance(model, SparseBtf):
                    raise NacreError(f"{path}: not a sparse model; only those can be mixed")
                if part == "blended":
                    model = model.truncated(self._shown or model.quality)
                    found[part] = (build_any_tables(model, progress=share(number)),)
                    continue
                tables = build_node_tables(model, progress=share(number))
                if part == "occlusion":
                    mapping = MAPPINGS.get(model.dataset.get("value", ""), MAPPINGS["mask"])
                    found[part] = tables, mapping
                else:
                    found[part] = tables, environment_for(kept, tables)
            return found

        return work

    def finish(self, context: bpy.types.Context, result: Any) -> None:
        from ..nodes.kept_world import kept_world
        from ..nodes.material import (
            group_of,
            set_blended,
            set_coverage,
            set_final_tables,
            set_tables,
        )
        from ..nodes.packed_tables import is_sparse
        from ..nodes.sparse_blend import blended_with
        from ..quality_slider import set_quality

        if "model" in result:
            set_tables(self._material, *result["model"])
        set_final_tables(self._material, *result.get("final_model", (None,)))
        if "blended" in result or blended_with(group_of(self._material)) is not None:
            set_blended(self._material, *result.get("blended", (None,)))
        set_coverage(self._material, *result.get("occlusion", (None,)))
        if "model" in result:
            set_quality(self._material, self._shown, self._shown, self._best)
        shown = self._material.name
        if kept_world(self._material.node_tree) and is_sparse(group_of(self._material)):
            self.report({"WARNING"}, f"Updated {shown}: a sparse model is not lit by the world")
        else:
            self.report({"INFO"}, f"Updated the material {shown}")
