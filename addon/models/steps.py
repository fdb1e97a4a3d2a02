"""Progress of work whose number of steps shows only on the way."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float, str], bool]


class Steps:
    """Divides what is left of a progress bar among the steps that are expected to be left.

    A step more than expected takes its part of the rest, one less lets the bar jump: it never goes
    back.
    """

    def __init__(self, progress: Progress | None) -> None:
        self._progress = progress or (lambda fraction, message: True)
        self._done = 0.0

    def step(self, left: int) -> Progress:
        """The progress callback of the next step, one of `left` equal ones."""
        begin = self._done
        self._done += (1.0 - begin) / max(left, 1)
        share = self._done - begin
        return lambda fraction, message: self._progress(begin + share * fraction, message)
