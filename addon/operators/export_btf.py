"""The scene's dataset to a file of other programs: a .btf or a UBO2003 zip."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import bpy
from bpy.props import EnumProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..datasets.btf_writer import COMPONENTS, write_btf
from ..datasets.dataset import open_dataset
from ..datasets.ubo2003_writer import write_ubo2003
from ..facts import size_text
from ..jobs import JobOperator, Work
from .ready import is_ready

COLOUR_MODELS = {"RGB": 0, "LOG": 11}


class NACRE_OT_export_btf(JobOperator, bpy.types.Operator, ExportHelper):
    """Write the dataset as a measured file that other programs read"""

    bl_idname = "nacre.export_btf"
    bl_label = "Export BTF"

    filename_ext = ""
    filter_glob: StringProperty(default="*.btf;*.zip", options={"HIDDEN"})
    kind: EnumProperty(
        name="Format",
        description="What is written",
        items=(
            (".btf", "UBO2014 (.btf)", "Bonn's factorised matrix: small, with some loss"),
            (".zip", "UBO2003 (.zip)", "A JPEG image for each pair of light and view: 8 bits"),
        ),
    )
    components: IntProperty(
        name="Components",
        description="Singular vectors of each color: more are nearer, and larger",
        default=COMPONENTS,
        min=1,
        max=4096,
        soft_max=256,
    )
    colour: EnumProperty(
        name="Color",
        description="What is factorised",
        items=(
            ("RGB", "RGB", "Nearest in squared error; every reader gives it back"),
            ("LOG", "Log Luminance", "As in Bonn's database: errors alike in dark and light"),
        ),
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not context.scene.nacre.dataset:
            cls.poll_message_set("Import, measure or choose a dataset first")
            return False
        return is_ready(cls)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        # What the file browser runs is `execute`, just as a script does.
        self._in_window = not bpy.app.background
        if not self.filepath:
            dataset = Path(bpy.path.abspath(context.scene.nacre.dataset))
            self.filepath = str(dataset.with_suffix(self.kind))
        return ExportHelper.invoke(self, context, event)

    def check(self, context: bpy.types.Context) -> bool:
        """Let the name end as the format asks for."""
        path = str(Path(self.filepath).with_suffix(self.kind)) if self.filepath else ""
        changed, self.filepath = path != self.filepath, path
        return changed

    def execute(self, context: bpy.types.Context) -> set[str]:
        return (
            self.start(context) if getattr(self, "_in_window", False) else super().execute(context)
        )

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(self, "kind")
        if self.kind == ".btf":
            layout.prop(self, "components")
            layout.prop(self, "colour")

    def prepare(self, context: bpy.types.Context) -> Work:
        dataset = open_dataset(bpy.path.abspath(context.scene.nacre.dataset))
        path = Path(bpy.path.abspath(self.filepath))
        if path.suffix.lower() not in (".btf", ".zip"):
            path = path.with_name(path.name + self.kind)
        self._path = path
        if path.suffix.lower() == ".zip":
            return lambda progress: write_ubo2003(dataset, path, progress=progress)
        model = COLOUR_MODELS[self.colour]
        write = partial(write_btf, dataset, path, components=self.components, colour_model=model)
        return lambda progress: write(progress=progress)

    def finish(self, context: bpy.types.Context, result: dict[str, Any]) -> None:
        snr = result.get("snr_db")
        quality = f", {snr:.1f} dB" if snr is not None else ""
        self.report({"INFO"}, f"Wrote {self._path.name}: {size_text(result['bytes'])}{quality}")


def draw_export_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """The entry in File > Export."""
    self.layout.operator(NACRE_OT_export_btf.bl_idname, text="BTF (.btf, .zip)")
