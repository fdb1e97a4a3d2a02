"""A measurement under way: a folder of finished pictures that outlives a cancel or a crash.

`.NAME.measuring`, beside the dataset NAME that it becomes, holds `measurement.json`, all that the
result depends on, and one file for each finished picture, which appears only when it is whole.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import NacreError

_DESCRIPTION, _SAMPLES = "measurement.json", "samples.txt"
_NO_ROOM = {errno.ENOSPC, errno.EFBIG, errno.EDQUOT}


class Unfinished:
    """The finished pictures of a measurement; a context manager, which leaves no empty folder.

    `path` is the dataset to be, `measurement` JSON-able, all that its pictures depend on. A folder
    of the same measurement is gone on with; `resume` does so whatever its "origin" was, `restart`
    throws it away. Raises NacreError for a folder of another measurement and for one that cannot be
    written.
    """

    def __init__(
        self, path: Path, measurement: dict[str, Any], resume: bool = False, restart: bool = False
    ) -> None:
        self._path = path
        self.folder = unfinished_folder(path)
        text = json.dumps(measurement, indent=1, allow_nan=False)
        if restart:
            self.remove()
        if count_finished(path):
            self._check(json.loads(text), resume)
            return
        self.remove()  # killed before it got anywhere
        with_errors(path, self.folder.mkdir)
        try:
            self._write(_DESCRIPTION, lambda file: file.write_text(text + "\n", encoding="utf-8"))
        except BaseException:
            self.remove()
            raise

    def __enter__(self) -> Unfinished:
        return self

    def __exit__(self, *_: object) -> None:
        if not count_finished(self._path):
            self.remove()

    def save(self, number: int, values: np.ndarray, noise: np.ndarray) -> None:
        """Keep picture `number`: its values and what is known of its noise.

        Values stay half floats where those can hold them. Raises NacreError when the disk is full.
        """
        with np.errstate(over="ignore"):
            half = values.astype(np.float16)
        stored = half if np.isfinite(half).all() else values.astype(np.float32)

        def write(file: Path) -> None:
            with file.open("wb") as stream:
                np.savez(stream, values=stored, noise=noise)
                stream.flush()
                os.fsync(stream.fileno())

        self._write(_name(number), write)

    def load(self, number: int) -> tuple[np.ndarray, np.ndarray] | None:
        """The values and noise of picture `number`; None when it is missing or damaged."""
        try:
            with (
                (self.folder / _name(number)).open("rb") as file,
                np.load(file, allow_pickle=False) as found,
            ):
                return found["values"], found["noise"]
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None

    def finished(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """As `load`, of a picture that was there; NacreError when it is not any more."""
        found = self.load(number)
        if found is None:
            raise NacreError(f"{self.folder.name}: picture {number} was lost; measure again")
        return found

    def save_samples(self, samples: int) -> None:
        """Keep how many samples a noise target takes."""
        self._write(_SAMPLES, lambda file: file.write_text(f"{samples}\n", encoding="utf-8"))

    def samples(self) -> int | None:
        """What `save_samples` kept; None before."""
        try:
            return int((self.folder / _SAMPLES).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None

    def remove(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    def _check(self, measurement: dict[str, Any], resume: bool) -> None:
        try:
            found = json.loads((self.folder / _DESCRIPTION).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            found = {}
        other = [key for key in measurement if found.get(key) != measurement[key]]
        if not other or (resume and other == ["origin"]):
            return
        if other == ["origin"]:
            raise NacreError(
                f"{self._path.name} has an unfinished measurement, but the scene was saved since: "
                "resume to go on with it, or restart to throw it away"
            )
        raise NacreError(
            f"{self._path.name} has an unfinished measurement with other {', '.join(other)}: give "
            "the same settings to go on with it, or restart to throw it away"
        )

    def _write(self, name: str, write: Callable[[Path], Any]) -> None:
        """A file that is there as a whole or not at all."""
        part = self.folder / f"{name}.part"

        def both() -> None:
            write(part)
            part.replace(self.folder / name)

        with_errors(self._path, both)


def unfinished_folder(path: Path) -> Path:
    """Where the finished pictures of the dataset `path` are until it is whole."""
    return path.with_name(f".{path.name}.measuring")


def count_finished(path: Path) -> int:
    """How many pictures of the dataset `path` are there already."""
    return sum(1 for _ in unfinished_folder(path).glob("[0-9]*.npz"))


def with_errors(path: Path, write: Callable[[], Any]) -> None:
    """Let `write` touch the disk; NacreError in terms of the dataset `path` where it cannot."""
    try:
        write()
    except OSError as error:
        if error.errno in _NO_ROOM:
            raise NacreError(
                f"no room to write {path}: free space and measure again, which goes on from here"
            ) from error
        raise NacreError(f"cannot write {path}: {error.strerror}") from error


def _name(number: int) -> str:
    return f"{number:05d}.npz"
