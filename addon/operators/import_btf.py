"""A measured file to a dataset: from the File menu, by drag and drop, from the panel."""

import tempfile
from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ..datasets.dataset import Dataset
from ..datasets.importing import EXTENSIONS, import_dataset
from ..errors import NacreError
from ..facts import source_facts, source_takes
from ..jobs import JobOperator, Progress, Work
from ..panels.layout import draw_facts
from .import_options import ImportOptions
from .ready import is_ready


class NACRE_OT_import_btf(JobOperator, ImportOptions, bpy.types.Operator, ImportHelper):
    """Read a measured BTF, a BRDF or occlusion masks into a dataset folder"""

    bl_idname = "nacre.import_btf"
    bl_label = "Import BTF"
    # The file browser would push an undo step before the work is done: `finish` pushes it instead.
    bl_options = {"REGISTER"}

    filter_glob: StringProperty(
        default=";".join(f"*{ending}" for ending in EXTENSIONS), options={"HIDDEN"}
    )
    filepath: StringProperty(
        name="File",
        description="Measured BTF, a .btf of Bonn's or a .zip of images named by their angles; a "
        "BRDF of the RGL, KAIST, MERL or UTIA databases; a list of images, .csv; masks, .npy",
        subtype="FILE_PATH",
        options={"SKIP_SAVE", "HIDDEN"},
    )
    destination: StringProperty(
        name="Save As",
        description="Dataset folder to write; when empty, NAME.nacre beside the file, or among "
        "Blender's own files where that cannot be written",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return is_ready(cls)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        # What the file browser and the dialog run is `execute`, just as a script does.
        self._in_window = not bpy.app.background
        if self.filepath:  # dropped on the window
            return context.window_manager.invoke_props_dialog(
                self, title=Path(self.filepath).name, confirm_text="Import", width=340
            )
        return ImportHelper.invoke(self, context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        if getattr(self, "_in_window", False):
            return self.start(context)
        return super().execute(context)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        takes = self._takes()
        draw_facts(context, layout, source_facts(self.filepath, **self._options(takes)))
        self.draw_options(layout, takes)
        layout.prop(self, "destination", placeholder=self._usual_destination().name)

    def prepare(self, context: bpy.types.Context) -> Work:
        if not self.filepath or Path(self.filepath).is_dir():
            raise NacreError(f"no file is chosen: choose a {' or a '.join(EXTENSIONS)}")
        source = bpy.path.abspath(self.filepath)
        options = self._options(self._takes())
        destination = Path(bpy.path.abspath(self.destination))
        if not self.destination:
            destination = self._usual_destination()
            if not _is_writable(destination.parent):
                destination = _own_folder() / destination.name

        def work(progress: Progress) -> Dataset:
            return import_dataset(source, destination, progress=progress, **options)

        return work

    def finish(self, context: bpy.types.Context, result: Dataset) -> None:
        context.scene.nacre.dataset = str(result.path)
        self.report({"INFO"}, f"Imported {result.path}")
        bpy.ops.ed.undo_push(message=self.bl_label)

    def _takes(self) -> frozenset[str]:
        """The options that the file's format takes; none before a file is chosen."""
        return source_takes(self.filepath, bpy.path.abspath(self.directions))

    def _options(self, takes: frozenset[str]) -> dict[str, Any]:
        """What was chosen; in the window, of what is to be seen there."""
        options = self.chosen_options()
        if getattr(self, "_in_window", False):
            options = {name: value for name, value in options.items() if name in takes}
        return options

    def _usual_destination(self) -> Path:
        return Path(bpy.path.abspath(self.filepath) or "NAME").with_suffix(".nacre")


class NACRE_FH_btf(bpy.types.FileHandler):
    """Drop a measured file on the 3D viewport"""

    bl_idname = "NACRE_FH_btf"
    bl_label = "BTF"
    bl_import_operator = NACRE_OT_import_btf.bl_idname
    bl_file_extensions = ";".join(EXTENSIONS)

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return context.area is not None and context.area.type == "VIEW_3D"


def draw_import_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """The entry in File > Import."""
    self.layout.operator(NACRE_OT_import_btf.bl_idname, text="BTF, BRDF (.btf, .zip, .bsdf)")


def _is_writable(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _own_folder() -> Path:
    """The extension's own folder for user files."""
    package = __package__.removesuffix(".operators")
    try:
        return Path(bpy.utils.extension_path_user(package, path="datasets", create=True))
    except ValueError:  # run from a checkout, not as an extension
        raise NacreError("the file's folder cannot be written: give a dataset folder") from None
