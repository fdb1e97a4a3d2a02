"""The quality of sparse models while they are shown: a material's slider, and files that are shown
while they are read.

Tables are built on a thread from as much of the file as a quality asks for, and set on the main
thread. There is one thread a material: a slider that moves on while it works is followed when it
is done, so that dragging takes no longer than the last of its values.
"""

from __future__ import annotations

import os
import threading
import traceback
from collections import deque
from collections.abc import Iterator
from functools import lru_cache, partial
from typing import TYPE_CHECKING, NamedTuple

import bpy

from . import wheels
from .errors import NacreError

if TYPE_CHECKING:
    from .models.sparse.files import OpenFile
    from .properties import NACRE_PG_material
    from .tables.any_tables import AnyTables

INTERVAL = 0.05
"""Seconds between two looks at a thread."""

KEPT = 2
"""Files whose coefficients are kept for another quality."""


class Wanted(NamedTuple):
    """What a material is to show: a file, its quality, and as what: "model", "blended" with it, or
    "final" in final renders only."""

    path: str
    quality: int
    part: str = "model"


class Reading(threading.Thread):
    """Tables of what a material wants, better and better ones; it must not touch bpy."""

    def __init__(self, material: int, wanted: tuple[Wanted, ...]) -> None:
        super().__init__(name="Nacre quality", daemon=True)
        self.material = material
        self.wanted = wanted
        self.found: dict[Wanted, tuple[int, AnyTables]] = {}
        self.error: Exception | None = None
        self.outdated = False  # something else is wanted by now
        self.stopped = False  # nothing of it is to be shown

    def run(self) -> None:
        try:
            for wanted in self.wanted:
                for quality, tables in _coming(wanted):
                    self.found[wanted] = quality, tables
                    if self.outdated or self.stopped:
                        return
        except Exception as error:  # the main thread shows it
            self.error = error


def follow_quality(material: bpy.types.Material) -> None:
    """Bring the tables of a material to the quality it asks for; in the background at once."""
    if wheels.missing() is not None or _is_followed(material.nacre):
        return
    if any(one.material == material.session_uid for one in _readings()):
        return  # sees the new quality when it is done
    reading = Reading(material.session_uid, wanted_of(material))
    if bpy.app.background:
        reading.run()
        look(reading)
        return
    reading.start()
    bpy.app.timers.register(partial(look, reading), first_interval=INTERVAL)


def follow_qualities() -> None:
    """Follow what was loaded or undone between a slider's move and its tables."""
    if wheels.missing() is not None:
        return
    from .nodes.material import nacre_materials

    for material in nacre_materials():
        follow_quality(material)


def wanted_of(material: bpy.types.Material) -> tuple[Wanted, ...]:
    """What a material asks for; another quality in final renders waits in another group."""
    from .nodes.material import group_of
    from .nodes.sparse_blend import blended_with

    settings = material.nacre
    path = bpy.path.abspath(settings.model)
    wanted = [Wanted(path, settings.quality)]
    if _final(settings):
        wanted.append(Wanted(path, _final(settings), "final"))
    if settings.blended and blended_with(group_of(material)) is not None:
        path = bpy.path.abspath(settings.blended)
        wanted.append(Wanted(path, settings.quality, "blended"))
    return tuple(wanted)


def _final(settings: NACRE_PG_material) -> int:
    """The quality of final renders; 0 where it is that of all, or another file's."""
    return 0 if settings.final_model else settings.final_quality


def _is_followed(settings: NACRE_PG_material) -> bool:
    """Whether the nodes hold what the sliders ask for."""
    shown = (settings.shown_quality, settings.shown_final)
    return not settings.file_quality or shown == (settings.quality, _final(settings))


def look(reading: Reading) -> float | None:
    """Show what a thread has found; seconds until the next look, or None when it is done."""
    if reading.stopped:
        return None
    if bpy.app.is_job_running("RENDER"):  # the trees it reads must not be written
        return INTERVAL
    alive = reading.is_alive()
    uid = reading.material
    material = next((item for item in bpy.data.materials if item.session_uid == uid), None)
    if material is None:
        reading.stopped = True
        return None
    for wanted in reading.wanted:
        if wanted in reading.found:
            _show(material, wanted, *reading.found.pop(wanted))
    reading.outdated = wanted_of(material) != reading.wanted
    if alive:
        return INTERVAL
    if reading.error is not None:
        _say(material, reading.error)
    elif reading.outdated:
        follow_quality(material)
    else:
        _finish(material)
    return None


def stop() -> None:
    """Let no thread show anything any more."""
    for reading in _readings():
        reading.stopped = True


def set_quality(material: bpy.types.Material, shown: int, wanted: int, best: int) -> None:
    """Tell a material which quality its nodes hold now, which it is to show, and which its file
    has; 0 for a model without a slider. Follows when they are not the same."""
    settings = material.nacre
    settings.problem = ""
    settings.file_quality, settings.shown_quality, settings.shown_final = best, shown, 0
    if best:
        settings.quality = min(wanted, best)


def _show(material: bpy.types.Material, wanted: Wanted, quality: int, tables: AnyTables) -> None:
    from .nodes.material import set_blended, set_final_tables, set_tables

    if wanted.part == "final":
        set_final_tables(material, tables)
    elif wanted.part == "blended":
        set_blended(material, tables)
    else:
        set_tables(material, tables)
        material.nacre.shown_quality = quality


def _finish(material: bpy.types.Material) -> None:
    """All that was wanted is shown, or all that there is."""
    from .nodes.material import set_final_tables

    settings = material.nacre
    settings.problem = ""
    if not _final(settings) and not settings.final_model:
        set_final_tables(material, None)
    settings.shown_final = _final(settings)
    if settings.shown_quality < settings.quality:
        settings.problem = f"The file was cut short: it ends at quality {settings.shown_quality}"
        settings.file_quality = settings.quality = settings.shown_quality


def _say(material: bpy.types.Material, error: Exception) -> None:
    if not isinstance(error, NacreError):
        traceback.print_exception(error)
    material.nacre.problem = str(error).splitlines()[0]


def _coming(wanted: Wanted) -> Iterator[tuple[int, AnyTables]]:
    from .nodes.loops import has_zones
    from .nodes.node_tables import build_node_tables
    from .tables.any_tables import build_any_tables

    try:
        status = os.stat(wanted.path)
    except OSError as error:
        raise NacreError(f"{wanted.path}: cannot be read ({error.strerror})") from error
    file = _opened(wanted.path, status.st_mtime_ns, status.st_size)
    models = file.up_to(wanted.quality)
    if not has_zones():  # each would be fitted
        models = deque(models, maxlen=1)
    build = build_any_tables if wanted.part == "blended" else build_node_tables
    for model in models:
        yield model.quality, build(model)


@lru_cache(maxsize=KEPT)
def _opened(path: str, _time: int, _size: int) -> OpenFile:
    from .models.sparse.files import OpenFile

    return OpenFile(path)


def _readings() -> list[Reading]:
    return [one for one in threading.enumerate() if isinstance(one, Reading) and not one.stopped]
