"""The state of long work on disk, from which it goes on after it was killed."""

from __future__ import annotations

import json
import os
import time
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..datasets.dataset import Dataset
from ..errors import NacreError

_SHARE = 0.03  # of the time may go into saving
_LEAST = 1.0  # seconds between two states


def samples_of(dataset: Dataset) -> list[Any]:
    """What tells the samples of a dataset from others, JSON-able."""
    samples = os.stat(dataset.path / "samples.npy")
    return [list(dataset.shape), str(dataset.samples.dtype), samples.st_mtime_ns]


class StateFile:
    """One file `path`: settings of some work, JSON-able, and its arrays and what else it knows."""

    def __init__(self, path: Path, settings: Any) -> None:
        self._path = path
        self._settings = json.dumps(settings, sort_keys=True)
        self._saved = time.monotonic()
        self._seconds = 0.0

    @property
    def due(self) -> bool:
        """Whether another state may be saved without slowing the work down."""
        passed = time.monotonic() - self._saved
        return passed >= max(_LEAST, self._seconds / _SHARE)

    def save(self, arrays: Mapping[str, NDArray[Any]], rest: Mapping[str, Any]) -> None:
        """Keep a state in place of the last one; NacreError when there is no room."""
        begun = time.monotonic()
        about = np.array([self._settings, json.dumps(rest)])
        stored: dict[str, Any] = {"about": about, **arrays}
        part = self._path.with_name(self._path.name + ".part")
        try:
            self._path.parent.mkdir(exist_ok=True)
            with part.open("wb") as file:
                np.savez(file, **stored)
            part.replace(self._path)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise NacreError(f"cannot write {self._path}: {error.strerror}") from error
        self._saved = time.monotonic()
        self._seconds = self._saved - begun

    def load(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]] | None:
        """The state to go on from, or None; NacreError if it is damaged or of other work."""
        if not self._path.exists():
            return None
        try:
            with self._path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
                arrays = dict(stored.items())
            settings, text = (str(text) for text in arrays.pop("about"))
            rest: dict[str, Any] = json.loads(text)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise self.damaged() from error
        if settings != self._settings:
            raise NacreError(
                f"{self._path} is the state of work with other settings or samples: give the same "
                "ones, or run without --resume to begin again"
            )
        return arrays, rest

    def damaged(self) -> NacreError:
        """What to say of a state that makes no sense."""
        return NacreError(f"{self._path} is damaged: run without --resume to begin again")

    def remove(self) -> None:
        """Forget the state."""
        for path in (self._path, self._path.with_name(self._path.name + ".part")):
            with suppress(OSError):
                path.unlink(missing_ok=True)


class Checkpoint:
    """The state of a tensor fit, as the compiled helper hands it out."""

    def __init__(self, path: Path, settings: Mapping[str, Any], dataset: Dataset) -> None:
        self._file = StateFile(path, [settings, *samples_of(dataset)])

    def save(self, state: Mapping[str, Any]) -> None:
        """Keep a state, unless the fit is so fast that saving would slow it down."""
        if not self._file.due:
            return
        arrays = {f"basis{n}": basis for n, basis in enumerate(state["basis"])}
        arrays |= {f"members{mode}": rows for mode, rows in state.get("members", {}).items()}
        rest = {key: state[key] for key in state if key not in ("core", "basis", "members")}
        self._file.save({"core": state["core"], **arrays}, rest)

    def load(self) -> dict[str, Any] | None:
        """The state to go on from, or None; NacreError if it is damaged or of another fit."""
        found = self._file.load()
        if found is None:
            return None
        arrays, state = found
        try:
            state["core"] = arrays.pop("core")
            state["basis"] = [arrays.pop(f"basis{n}") for n in range(state["core"].ndim - 1)]
            state["members"] = {
                int(name.removeprefix("members")): rows for name, rows in arrays.items()
            }
        except (ValueError, KeyError) as error:
            raise self._file.damaged() from error
        return state

    def remove(self) -> None:
        """Forget the state."""
        self._file.remove()
