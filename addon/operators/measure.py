"""A piece of the scene to a dataset, with Cycles as the instrument.

In the window a second Blender measures a copy of the file: this one stays usable, and untouched
whatever happens. Without a window the measurement runs where it was called.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
from bpy.props import BoolProperty

from ..datasets.dataset import Dataset, check_destination, open_dataset
from ..datasets.direction_sets import direction_set
from ..errors import Cancelled, NacreError
from ..jobs import JobOperator, Progress, Work
from ..measure.request import Request, measure
from ..measure.settings import Settings
from ..measure.unfinished import count_finished
from ..measurement_properties import NACRE_PG_measurement, directions, item_to_measure
from ..second_blender import follow, nacre_command, save_copy
from .ready import is_ready


class NACRE_OT_measure(JobOperator, bpy.types.Operator):
    """Measure the patch from all views under all lights"""

    bl_idname = "nacre.measure"
    bl_label = "Measure"
    bl_options = {"UNDO"}

    restart: BoolProperty(
        name="Start Over",
        description="Throw away the pictures of an unfinished measurement",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        chosen = context.scene.nacre.measurement
        if item_to_measure(chosen, context) is None:
            cls.poll_message_set(f"Choose the {chosen.what.lower()} to measure")
            return False
        return is_ready(cls)

    def prepare(self, context: bpy.types.Context) -> Work:
        chosen = context.scene.nacre.measurement
        item = item_to_measure(chosen, context)
        output = check_destination(dataset_to_write(chosen, item))
        asked = request(chosen, self.restart)
        direction_set(asked.views)  # a mistake in a file is better said before the work begins
        lights = len(direction_set(asked.lights))
        if bpy.app.background:
            origin = bpy.data.filepath
            return lambda progress: measure(item, output, asked, origin=origin, progress=progress)
        folder = tempfile.TemporaryDirectory()
        scene = save_copy(folder.name)
        command = nacre_command("measure", str(scene), str(output))
        command.append(f"--{chosen.what.lower()}={item.name}")
        command += asked.arguments()

        def work(progress: Progress) -> Dataset:
            with folder:
                return _measure_there(command, output, lights, progress)

        return work

    def finish(self, context: bpy.types.Context, result: Dataset) -> None:
        context.scene.nacre.dataset = str(result.path)
        floor = result.noise_floor_db
        noise = f", noise floor {floor:.1f} dB" if floor is not None else ""
        self.report({"INFO"}, f"Measured {result.path}{noise}")


def dataset_to_write(chosen: NACRE_PG_measurement, item: bpy.types.ID | None) -> Path:
    """The dataset folder that a measurement becomes. Raises NacreError without any."""
    if chosen.output:
        path = Path(bpy.path.abspath(chosen.output))
        return path if path.suffix == ".nacre" else path.with_name(f"{path.name}.nacre")
    if not bpy.data.filepath or item is None:
        raise NacreError("save the .blend file first, or say where to save the dataset")
    name = bpy.path.clean_name(item.name)
    return Path(bpy.data.filepath).with_name(f"{name}.nacre")


def request(chosen: NACRE_PG_measurement, restart: bool) -> Request:
    """The choices as one measurement. Raises NacreError for what cannot be measured."""
    size = (chosen.width, chosen.height or chosen.width) if chosen.width > 0.0 else None
    noise = {"noise_db": chosen.noise_db} if chosen.use_noise_target else {}
    return Request(
        kind="btf" if chosen.kind == "BTF" else "occlusion",
        value="signed-distance" if chosen.kind == "DISTANCE" else "mask",
        size=size,
        views=directions(chosen, "view"),
        lights=directions(chosen, "light"),
        settings=Settings(chosen.texels, chosen.samples, **noise, bounces=chosen.bounces,
                          seed=chosen.seed),
        # Each copy of the file differs in its bytes: whether the scene did is the user's to know.
        resume=not restart,
        restart=restart,
    )  # fmt: skip


def _measure_there(command: list[str], output: Path, lights: int, progress: Progress) -> Dataset:
    """Run another Blender and follow the pictures that it finishes, which stay for the next time
    when it is cancelled."""
    before = count_finished(output)

    def look() -> None:
        done = count_finished(output)
        message = f"Light {done + 1} of {lights}" if done > before else "Preparing"
        # Of what is left to do now, so that it tells the time left.
        if not progress((done - before) / max(lights - before, 1), message):
            raise Cancelled

    follow(command, look)
    return open_dataset(output)
