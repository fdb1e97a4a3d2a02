"""Reads fields one after the other, and never past the end."""

import io
import struct
from typing import BinaryIO

from ...errors import NacreError


class Cursor:
    """Little-endian fields of a file of `size` bytes; `problem` begins what is said of a short one.

    `name` is the file's, for messages.
    """

    def __init__(self, file: BinaryIO, size: int, name: str, problem: str = "") -> None:
        self.name = name
        self._file = file
        self._size = size
        self._problem = problem or f"{name} is cut short or damaged"

    @property
    def left(self) -> int:
        return self._size - self._file.tell()

    def need(self, count: int, what: str) -> None:
        if count > self.left:
            raise NacreError(f"{self._problem}: {what} needs {count} bytes, {self.left} are left")

    def take(self, count: int, what: str) -> bytes:
        self.need(count, what)
        return self._file.read(count)

    def skip(self, count: int, what: str) -> int:
        """Pass over `count` bytes; returns where they start."""
        self.need(count, what)
        start = self._file.tell()
        self._file.seek(count, io.SEEK_CUR)
        return start

    def back(self, count: int) -> None:
        """Return over bytes that were taken."""
        self._file.seek(-count, io.SEEK_CUR)

    def numbers(self, layout: str, what: str) -> tuple:
        layout = "<" + layout
        return struct.unpack(layout, self.take(struct.calcsize(layout), what))

    def u32(self, what: str) -> int:
        return self.numbers("I", what)[0]

    def damaged(self, problem: str) -> NacreError:
        """An error to raise, on one line."""
        return NacreError(f"{self.name} is damaged: {problem}")

    def end(self) -> None:
        if self.left:
            raise self.damaged(f"{self.left} bytes follow its end")
