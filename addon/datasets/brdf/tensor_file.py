"""The tensor container of the RGL database (`.bsdf`) and of polarimetric BRDFs (`.pbsdf`).

"tensor_file" and a zero byte, version 1.0, the number of fields; of each field its name, its
element type, its shape and the offset of its elements, which are little-endian in C order. Axes may
be of length zero, and fields may share their elements.
"""

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import NacreError

MAGIC = b"tensor_file\0\x01\0"
"""What a file of version 1.0 starts with."""

_UNVERSIONED = MAGIC[:-2]
_DTYPES: dict[int, np.dtype] = {
    1: np.dtype("u1"),
    2: np.dtype("i1"),
    3: np.dtype("<u2"),
    4: np.dtype("<i2"),
    5: np.dtype("<u4"),
    6: np.dtype("<i4"),
    7: np.dtype("<u8"),
    8: np.dtype("<i8"),
    9: np.dtype("<f2"),
    10: np.dtype("<f4"),
    11: np.dtype("<f8"),
}
_MOST_AXES = 16
_MOST_FIELDS = 1024


@dataclass(frozen=True)
class Field:
    """Where an array lies in the file; all of it is inside."""

    name: str
    dtype: np.dtype
    shape: tuple[int, ...]
    offset: int


@dataclass(frozen=True)
class TensorFile:
    """The fields of a file by their names; elements are read when they are asked for."""

    path: Path
    bytes: int
    fields: dict[str, Field]

    def field(self, name: str, dtype: str, axes: int) -> Field:
        """A field that must be there, of elements `dtype` (as in "f4") and with so many axes."""
        field = self.fields.get(name)
        if field is None:
            found = ", ".join(self.fields) or "none"
            raise NacreError(f"{self.path.name} has no field {name}; its fields: {found}")
        if field.dtype != np.dtype(dtype) or len(field.shape) != axes:
            raise NacreError(
                f"{self.path.name}: the field {name} holds {field.dtype.name} of shape "
                f"{field.shape}; expected {np.dtype(dtype).name} with {axes} axes"
            )
        return field

    def read(self, field: Field) -> np.ndarray:
        """The elements of a field, in memory."""
        return np.array(self.map(field))

    def map(self, field: Field) -> np.ndarray:
        """The elements of a field, mapped and read-only."""
        if math.prod(field.shape) == 0:
            return np.empty(field.shape, field.dtype)
        return np.memmap(
            self.path, dtype=field.dtype, mode="r", offset=field.offset, shape=field.shape
        )

    def reshaped(self, field: Field, shape: Sequence[int]) -> Field:
        """The same place in the file with another shape, if the file is long enough for it."""
        return _checked(
            Field(field.name, field.dtype, tuple(shape), field.offset), self.bytes, self.path.name
        )


def open_tensor_file(path: Path) -> TensorFile:
    """Read the list of fields, and check that the file holds all of their elements.

    Raises NacreError, one line that names the file and the field, and OSError.
    """
    with path.open("rb") as file:
        start = file.read(len(MAGIC))
        if start != MAGIC:
            raise NacreError(_not_this(start, path.name))
        size = path.stat().st_size
        cursor = _Cursor(file.read, path.name)
        (count,) = cursor.numbers("I", "the number of fields")
        if count > _MOST_FIELDS:
            raise NacreError(
                f"{path.name} is damaged: it claims {count} fields; up to {_MOST_FIELDS} are read"
            )
        fields: dict[str, Field] = {}
        for number in range(1, count + 1):
            field = _read_field(cursor, number)
            if field.name in fields:
                raise NacreError(f"{path.name} is damaged: it has two fields {field.name}")
            fields[field.name] = _checked(field, size, path.name)
    return TensorFile(path, size, fields)


class _Cursor:
    """Reads little-endian fields one after the other."""

    def __init__(self, read: Callable[[int], bytes], name: str) -> None:
        self._read = read
        self.name = name

    def take(self, count: int, what: str) -> bytes:
        data = self._read(count)
        if len(data) < count:
            raise NacreError(f"{self.name} is cut short or damaged: it ends in {what}")
        return data

    def numbers(self, layout: str, what: str) -> tuple[int, ...]:
        layout = "<" + layout
        return struct.unpack(layout, self.take(struct.calcsize(layout), what))


def _not_this(start: bytes, name: str) -> str:
    if start.startswith(_UNVERSIONED) and len(start) == len(MAGIC):
        major, minor = start[-2:]
        return f"{name} is a tensor file of version {major}.{minor}; 1.0 is supported"
    return f"{name} is not a tensor file: it starts with {start[:11].decode('ascii', 'replace')!r}"


def _read_field(cursor: _Cursor, number: int) -> Field:
    place = f"field {number}"
    (length,) = cursor.numbers("H", f"{place}'s name")
    try:
        name = cursor.take(length, f"{place}'s name").decode("utf-8")
    except UnicodeDecodeError:
        name = ""
    if not name.isprintable() or not name:
        raise NacreError(f"{cursor.name} is damaged: {place} has a name that is no text")
    axes, kind, offset = cursor.numbers("HBQ", f"the field {name}")
    if axes > _MOST_AXES or kind not in _DTYPES:
        raise NacreError(
            f"{cursor.name} is damaged: the field {name} has {axes} axes of the element type "
            f"{kind}; up to {_MOST_AXES} and 1 to {len(_DTYPES)} are known"
        )
    return Field(name, _DTYPES[kind], cursor.numbers(f"{axes}Q", f"the field {name}"), offset)


def _checked(field: Field, size: int, name: str) -> Field:
    needed = math.prod(field.shape) * field.dtype.itemsize
    if needed and field.offset + needed > size:
        raise NacreError(
            f"{name} is cut short or damaged: the field {field.name} needs {needed} bytes from "
            f"{field.offset} on, the file has {size}"
        )
    return field
