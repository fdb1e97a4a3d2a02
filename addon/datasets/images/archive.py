"""The files in a zip or a folder, read one at a time. Nothing is ever unpacked to disk."""

import os
import stat
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath, PureWindowsPath

from ...errors import NacreError

# Far beyond any measured image.
_MOST = 2**28
# Images are compressed already. What unpacks to more than this, and to so many times its bytes in
# the zip, is meant to fill the memory.
_UNSUSPICIOUS = 2**24
_RATIO = 64


class Files(ABC):
    """Files by their names, which have / between folders."""

    @abstractmethod
    def names(self) -> list[str]:
        """All files but those that some systems keep beside the user's; may name one twice.

        Names are printable, so that an error has one line.
        """

    @abstractmethod
    def size(self, name: str) -> int:
        """The bytes that a file takes here; NacreError when there is none of this name."""

    @abstractmethod
    def read(self, name: str) -> bytes:
        """A file's content; NacreError, naming it, when it cannot be read or is absurdly large."""


@contextmanager
def open_files(path: Path) -> Iterator[Files]:
    """The files of a zip or a folder; NacreError for anything else."""
    if path.is_dir():
        yield _Folder(path)
        return
    try:
        archive = zipfile.ZipFile(path)
    except OSError as error:
        raise NacreError(f"cannot read {path}: {error.strerror}") from error
    except Exception as error:  # a damaged zip may raise more than BadZipFile
        raise NacreError(f"{path.name} is not a zip file or is cut short: {error}") from error
    with archive:
        yield _Zip(archive, path.stat().st_size)


class _Zip(Files):
    def __init__(self, archive: zipfile.ZipFile, size: int) -> None:
        self._archive = archive
        self._bytes = size
        self._entries = {entry.filename: entry for entry in archive.infolist()}

    def names(self) -> list[str]:
        entries = self._archive.infolist()
        return [
            entry.filename
            for entry in entries
            # In this order: Python 3.11's is_dir breaks on an entry without a name.
            if _is_users(PurePosixPath(entry.filename)) and not entry.is_dir()
        ]

    def size(self, name: str) -> int:
        if name not in self._entries:
            raise NacreError(f"there is no {name} in the zip")
        return min(self._entries[name].compress_size, self._bytes)

    def read(self, name: str) -> bytes:
        stored = self.size(name)
        if self._entries[name].compress_size > self._bytes:
            # Before Python 3.13 zipfile makes room for whatever is claimed.
            raise NacreError(f"{name} claims more bytes than the zip has")
        if self._entries[name].file_size > min(_MOST, max(_UNSUSPICIOUS, _RATIO * stored)):
            raise NacreError(f"{name} is too large for an image in a zip")
        try:
            return self._archive.read(name)
        except Exception as error:  # each decompressor has errors of its own
            raise NacreError(f"{name} cannot be read from the zip: {_reason(error)}") from error


class _Folder(Files):
    def __init__(self, path: Path) -> None:
        self._path = path
        self._resolved = path.resolve()

    def names(self) -> list[str]:
        names = []
        for folder, folders, files in os.walk(self._path):
            folders.sort()
            inside = Path(folder).relative_to(self._path)
            names += [(inside / file).as_posix() for file in sorted(files)]
        return [name for name in names if _is_users(PurePosixPath(name))]

    def size(self, name: str) -> int:
        try:
            status = self._inside(name).stat()
        except OSError as error:
            raise NacreError(f"cannot read {name}: {error.strerror}") from error
        if not stat.S_ISREG(status.st_mode):
            raise NacreError(f"{name!r} is no file")
        return status.st_size

    def read(self, name: str) -> bytes:
        if self.size(name) > _MOST:
            raise NacreError(f"{name} is too large for an image")
        try:
            return self._inside(name).read_bytes()
        except OSError as error:
            raise NacreError(f"cannot read {name}: {error.strerror}") from error

    def _inside(self, name: str) -> Path:
        """Where a file is; NacreError for a name that leads out of the folder."""
        if PureWindowsPath(name).anchor or ".." in PureWindowsPath(name).parts or "\0" in name:
            raise NacreError(f"{name!r} is outside of the folder {self._path.name}")
        path = self._path / name
        if not path.resolve().is_relative_to(self._resolved):
            raise NacreError(f"{name} leads out of the folder {self._path.name}")
        return path


def _is_users(path: PurePosixPath) -> bool:
    hidden = "__MACOSX" in path.parts or path.name.startswith(".")
    return bool(path.parts) and str(path).isprintable() and not hidden


def _reason(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
