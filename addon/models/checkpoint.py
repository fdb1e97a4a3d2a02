"""The state of a long fit on disk, from which it goes on after it was killed."""

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

from ..datasets.dataset import Dataset
from ..errors import NacreError

_SHARE = 0.03  # of the time may go into saving
_LEAST = 1.0  # seconds between two states


class Checkpoint:
    """One file `path`: the settings of a fit and its state, as the compiled helper hands it out."""

    def __init__(self, path: Path, settings: Mapping[str, Any], dataset: Dataset) -> None:
        self._path = path
        samples = os.stat(dataset.path / "samples.npy")
        self._settings = json.dumps(
            [settings, list(dataset.shape), str(dataset.samples.dtype), samples.st_mtime_ns],
            sort_keys=True,
        )
        self._saved = time.monotonic()
        self._seconds = 0.0

    def save(self, state: Mapping[str, Any]) -> None:
        """Keep a state, unless the fit is so fast that saving would slow it down."""
        now = time.monotonic()
        if now - self._saved < max(_LEAST, self._seconds / _SHARE):
            return
        arrays = {f"basis{n}": basis for n, basis in enumerate(state["basis"])}
        arrays |= {f"members{mode}": rows for mode, rows in state.get("members", {}).items()}
        rest = {key: state[key] for key in state if key not in ("core", "basis", "members")}
        part = self._path.with_name(self._path.name + ".part")
        try:
            with part.open("wb") as file:
                np.savez(
                    file,
                    core=state["core"],
                    about=np.array([self._settings, json.dumps(rest)]),
                    **arrays,
                )
            part.replace(self._path)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise NacreError(f"cannot write {self._path}: {error.strerror}") from error
        self._saved = time.monotonic()
        self._seconds = self._saved - now

    def load(self) -> dict[str, Any] | None:
        """The state to go on from, or None; NacreError if it is damaged or of another fit."""
        if not self._path.exists():
            return None
        try:
            with self._path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
                arrays = dict(stored.items())
            settings, rest = (str(text) for text in arrays.pop("about"))
            state: dict[str, Any] = json.loads(rest)
            state["core"] = arrays.pop("core")
            state["basis"] = [arrays.pop(f"basis{n}") for n in range(state["core"].ndim - 1)]
            state["members"] = {
                int(name.removeprefix("members")): rows for name, rows in arrays.items()
            }
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise NacreError(
                f"{self._path} is damaged: run without --resume to begin again"
            ) from error
        if settings != self._settings:
            raise NacreError(
                f"{self._path} is the state of a fit with other settings or samples: give the same "
                "ones, or run without --resume to begin again"
            )
        return state

    def remove(self) -> None:
        """Forget the state."""
        for path in (self._path, self._path.with_name(self._path.name + ".part")):
            with suppress(OSError):
                path.unlink(missing_ok=True)
