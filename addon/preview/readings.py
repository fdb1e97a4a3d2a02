"""Model files read on threads, so that the viewport stays live with a placeholder."""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import dataclass, field
from threading import Thread
from typing import Any

from .appearance import ModelFile, Read, find_model, read_tables


@dataclass
class Readings:
    """The files that were asked for; one that has changed since is read again."""

    files: dict[ModelFile, Future[Any]] = field(default_factory=dict)

    def tables_of(self, path: str) -> Read:
        """Tables once they are read; until then none, and that they are being read."""
        file = find_model(path)
        if file is None:
            return None, f"{path}: no such model file"
        if file not in self.files:
            for older in [other for other in self.files if other.path == path]:
                del self.files[older]
            self.files[file] = Future()
            # Not of a pool: Blender would wait for its threads when it closes.
            Thread(target=_read, args=(file, self.files[file]), daemon=True).start()
        if not self.files[file].done():
            return None, f"{path}: being read"
        return self.files[file].result()

    def running(self) -> list[Future[Any]]:
        """Those that are not read yet."""
        return [future for future in self.files.values() if not future.done()]


def _read(file: ModelFile, future: Future[Any]) -> None:
    try:
        future.set_result(read_tables(file))
    except BaseException as error:  # whoever asks for the result gets it
        future.set_exception(error)
