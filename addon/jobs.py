"""Long work that leaves the window usable: on a thread, with progress, time left and a way out.

The running thread itself is all that an operator, the panels and the cancel button share.
"""

import threading
import time
import traceback
from collections.abc import Callable
from typing import Any

import bpy

from .errors import Cancelled, NacreError

Progress = Callable[[float, str], bool]
Work = Callable[[Progress], Any]

INTERVAL = 0.1
"""Seconds between two looks at a job."""


class Job(threading.Thread):
    """A function work(progress) on a thread of its own; it must not touch bpy.

    `owner` names the operator that started it. Once `done`, either `error` or `result` is set.
    """

    def __init__(self, work: Work, owner: str = "") -> None:
        super().__init__(name=f"Nacre {owner}", daemon=True)
        self.owner = owner
        self.fraction = 0.0
        self.message = ""
        self.result: Any = None
        self.error: BaseException | None = None
        self.timer: bpy.types.Timer | None = None
        self.shown = ""
        self._work = work
        self._cancelled = threading.Event()
        self._begun = time.monotonic()

    def run(self) -> None:
        try:
            self.result = self._work(self._progress)
        except BaseException as error:  # the main thread judges it
            self.error = error

    def _progress(self, fraction: float, message: str) -> bool:
        self.fraction, self.message = min(max(fraction, 0.0), 1.0), message
        return not self._cancelled.is_set()

    def cancel(self) -> None:
        """Ask the work to stop; it does at its next call of progress."""
        self._cancelled.set()

    @property
    def cancelled(self) -> bool:
        return self._cancelled.is_set()

    @property
    def done(self) -> bool:
        return self.ident is not None and not self.is_alive()

    @property
    def seconds_left(self) -> float | None:
        """An estimate by the pace up to now; None when it is too early to tell."""
        elapsed = time.monotonic() - self._begun
        if elapsed < 0.5 or self.fraction < 0.02:
            return None
        return elapsed * (1.0 - self.fraction) / self.fraction

    def text(self) -> str:
        """How far it is and how long it will take, short enough for a bar."""
        iface = bpy.app.translations.pgettext_iface
        if self.cancelled:
            return iface("Cancelling")
        left = self.seconds_left
        if left is None:
            return f"{self.fraction:.0%}"
        if left < 90:
            return iface("{:.0%}, {:d} s left").format(self.fraction, round(left))
        return iface("{:.0%}, {:d} min left").format(self.fraction, round(left / 60))


def running() -> Job | None:
    """The job under way, if any."""
    return next((thread for thread in threading.enumerate() if isinstance(thread, Job)), None)


def stop() -> None:
    """End a job under way and wait for its end, when no operator will be there to follow it."""
    job = running()
    if job is not None:
        job.cancel()
        job.join()
        _leave(job)


class JobOperator:
    """What operators with long work share.

    A subclass gathers its input on the main thread (`prepare`), which gives the work, and writes
    the work's result to Blender on the main thread (`finish`). From the window the work runs on a
    thread (`start`); `execute`, as scripts and `blender -b` call it, does the same without one.
    """

    def prepare(self, context: bpy.types.Context) -> Work:
        """The work, which holds copies of all it needs. Raises NacreError."""
        raise NotImplementedError

    def finish(self, context: bpy.types.Context, result: Any) -> None:
        """Write the work's result to Blender. Raises NacreError."""
        raise NotImplementedError

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return self.start(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            work = self.prepare(context)
            self.finish(context, work(lambda fraction, message: True))
        except Exception as error:
            return self._fail(error)
        return {"FINISHED"}

    def start(self, context: bpy.types.Context) -> set[str]:
        """Begin the work on a thread and follow it until its end."""
        if bpy.app.background:  # no window, so no timer
            return self.execute(context)
        try:
            self._job = Job(self.prepare(context), type(self).bl_idname)
        except Exception as error:
            return self._fail(error)
        manager = context.window_manager
        self._job.timer = manager.event_timer_add(INTERVAL, window=context.window)
        manager.modal_handler_add(self)
        self._job.start()
        _show(context, self._job)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        job = self._job
        if event.type == "ESC" and event.value == "PRESS":
            job.cancel()
            _show(context, job)
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if not job.done:
            _show(context, job)
            return {"PASS_THROUGH"}
        _leave(job)
        if job.error is not None:
            return self._fail(job.error)
        try:
            self.finish(context, job.result)
        except Exception as error:
            return self._fail(error)
        return {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender ends the operator: another file is loaded, or the program quits."""
        job = getattr(self, "_job", None)
        if job is not None:
            job.cancel()
            job.join()
            _leave(job)

    def _fail(self, error: BaseException) -> set[str]:
        """Say in one line why there is no result."""
        if isinstance(error, Cancelled):
            translated = bpy.app.translations.pgettext_rpt
            self.report({"INFO"}, translated("{:s} cancelled").format(self.bl_label))
        elif isinstance(error, NacreError):
            self.report({"ERROR"}, str(error))
        elif isinstance(error, MemoryError):
            self.report({"ERROR"}, f"{self.bl_label}: not enough memory")
        else:
            traceback.print_exception(error)
            reason = f"{type(error).__name__} {error}".splitlines()[0][:200]
            self.report({"ERROR"}, f"{self.bl_label} failed: {reason} (details in the console)")
        return {"CANCELLED"}


def _show(context: bpy.types.Context, job: Job) -> None:
    """Bring status line and panels up to date."""
    key = bpy.app.translations.pgettext_iface("Esc: Cancel")
    text = f"{job.message}: {job.text()}    {key}"
    if text != job.shown:
        job.shown = text
        context.workspace.status_text_set(text)
        _redraw_sidebars(context.window_manager)


def _leave(job: Job) -> None:
    """Take back the timer and what `_show` showed."""
    manager = bpy.context.window_manager
    if job.timer is not None:
        manager.event_timer_remove(job.timer)
        job.timer = None
    for workspace in bpy.data.workspaces:  # the user may have changed to another one
        workspace.status_text_set(None)
    _redraw_sidebars(manager)


def _redraw_sidebars(manager: bpy.types.WindowManager) -> None:
    for window in manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":  # the picture beside it need not be drawn again
                        region.tag_redraw()
