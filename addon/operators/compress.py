"""A dataset to a model, with the method and quality chosen in the panel."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ..datasets.dataset import open_dataset
from ..datasets.occlusion import with_value
from ..datasets.quality import beyond_noise
from ..facts import parse_facts
from ..jobs import JobOperator, Progress, Work
from ..live import materials_showing
from ..properties import TARGETS, NACRE_PG_scene
from .ready import is_ready

if TYPE_CHECKING:
    from ..datasets.dataset import Dataset
    from ..models.any_model import Model
    from ..tables.any_tables import AnyTables
    from ..tables.environment import EnvironmentTable

    _Result = tuple[Path, int, AnyTables | None, list[EnvironmentTable | None]]


class NACRE_OT_compress(JobOperator, bpy.types.Operator):
    """Fit a model to the dataset and save it"""

    bl_idname = "nacre.compress"
    bl_label = "Compress"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not context.scene.nacre.dataset:
            cls.poll_message_set("Import a BTF or choose a dataset first")
            return False
        return is_ready(cls)

    def prepare(self, context: bpy.types.Context) -> Work:
        from ..models.any_model import quality_of_model
        from ..models.exr import check_destination, save_model
        from ..models.sparse.files import save_sparse
        from ..models.steps import Steps
        from ..nodes.kept_world import environment_for, kept_world
        from ..nodes.node_tables import build_node_tables

        chosen = context.scene.nacre
        dataset = open_dataset(bpy.path.abspath(chosen.dataset))
        output = check_destination(
            bpy.path.abspath(chosen.output) or dataset.path.with_suffix(".exr")
        )
        sparse = chosen.method == "SPARSE"
        save = save_sparse if sparse else save_model
        fit = (_sparse_fit if sparse else _tensor_fit)(chosen, dataset, output)

        # Materials that show the file that will be replaced are to show the new one.
        self._showing = materials_showing(output)
        worlds = [kept_world(material.node_tree) for material in self._showing]

        def work(progress: Progress) -> _Result:
            steps = Steps(progress)
            fitted = with_value(dataset, "signed-distance" if dataset.value else "")
            model = fit(fitted, progress=steps.step(2 if self._showing else 1))
            save(model, output)
            quality = quality_of_model(model)
            if not self._showing:
                return output, quality, None, []
            tables = build_node_tables(model, progress=steps.step(1))
            return output, quality, tables, [environment_for(world, tables) for world in worlds]

        return work

    def finish(self, context: bpy.types.Context, result: _Result) -> None:
        from ..nodes.material import set_tables
        from ..quality_slider import set_quality

        path, quality, tables, environments = result
        chosen = context.scene.nacre
        chosen.model = str(path)
        if tables is not None:
            for material, environment in zip(self._showing, environments, strict=True):
                set_tables(material, tables, environment)
                set_quality(material, quality, quality, quality)
        facts = ", ".join(value for _, value in parse_facts(chosen.model_facts)[1:])
        note = _beyond_noise(chosen)
        if note:
            self.report({"WARNING"}, f"Saved {path.name}, but {note}")
        else:
            self.report({"INFO"}, f"Saved {path.name}: {facts}")


def _tensor_fit(chosen: NACRE_PG_scene, dataset: Dataset, output: Path) -> Callable[..., Model]:
    """A fit of one of the tensor methods; the dataset and `progress` are still to be given."""
    from ..models.fit import compress, quality_settings
    from ..models.lightness import compress_by_lightness
    from ..models.target import compress_to_target

    method = chosen.method.lower()
    if chosen.quality in TARGETS:
        wanted = round(getattr(chosen, TARGETS[chosen.quality]), 6)  # a float, shown in decimals
        aim = {"snr_db" if chosen.quality == "TARGET_DB" else "megabytes": wanted}
        return partial(compress_to_target, method=method, folder=output.parent, **aim)
    settings = quality_settings(dataset, method, chosen.quality)
    if dataset.kind == "btf":
        return partial(compress_by_lightness, method=method, folder=output.parent, **settings)
    return partial(compress, method=method, **settings)


def _sparse_fit(chosen: NACRE_PG_scene, dataset: Dataset, _output: Path) -> Callable[..., Model]:
    """The same of sparse codes."""
    from ..models.sparse.coding import code
    from ..models.sparse.ensemble import choose
    from ..models.sparse.files import ensembles_of

    path = bpy.path.abspath(chosen.ensemble)
    ensemble = choose(ensembles_of([path] if path else []), dataset)
    return partial(code, ensemble=ensemble, sparsity=chosen.sparse_quality)


def _beyond_noise(chosen: NACRE_PG_scene) -> str:
    """What to say of a model that keeps noise."""
    from ..models.any_model import load_any

    dataset = open_dataset(bpy.path.abspath(chosen.dataset))
    return beyond_noise(load_any(chosen.model).fit.get("snr_db"), dataset.noise_floor_db)
