"""BDI, the bidirectional image file: all reflectance as half floats, one texel after the other.

A texel's values (its apparent BRDF) have the order view, light, channel, the channel fastest.
Texels lie in chunks of so many scan lines, each behind its number of bytes. A mask of one byte a
texel says which are there; in sparse files the others are not stored, and are 0. Chunks may be
packed: Bonn's name for that is bzip, which is taken to be a bzip2 stream for each, as btflib reads
sparse files only.
"""

import bz2
import io
from collections.abc import Generator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...errors import NacreError
from ..source import BLOCK_BYTES
from .contents import Contents
from .cursor import Cursor
from .header import Header, read_directions, read_meta, read_rotations, read_size

SIGNATURES = {b"!BDIF06R2!": True}
_FULL, _PACKED, _SPARSE = 0, 1, 2
_COMPRESSIONS = {_FULL: "full", _PACKED: "full, bzip2", _SPARSE: "sparse"}
_HALF = np.dtype("<f2")
_READ_BYTES = 2**16


@dataclass(frozen=True)
class _Chunk:
    """Where a chunk's bytes lie, and how many they are unpacked."""

    number: int
    offset: int
    bytes: int
    unpacked: int


def read(cursor: Cursor, signature: bytes) -> Contents:
    meta = read_meta(cursor)
    view, light = read_directions(cursor)
    width, height = read_size(cursor)
    lines, compression = cursor.numbers("IB", "the chunks' size")
    if lines == 0:
        raise cursor.damaged("its chunks have no scan lines")
    if compression not in _COMPRESSIONS:
        known = ", ".join(f"{number} {label}" for number, label in _COMPRESSIONS.items())
        raise NacreError(
            f"{cursor.name} has the unknown BDI compression {compression}; known are: {known}"
        )
    mask = np.frombuffer(cursor.take(width * height, "the mask"), np.uint8) != 0
    rotated = SIGNATURES[signature] and read_rotations(cursor)
    header = Header(meta, light, view, width, height, rotated)
    stored = mask if compression == _SPARSE else np.ones_like(mask)
    chunks = _read_chunks(cursor, header, int(stored.sum()), lines * width, compression == _PACKED)
    cursor.end()
    missing = int(mask.size - mask.sum())
    conversions = []
    if missing:
        what = "not stored, taken as 0" if compression == _SPARSE else "masked, taken as stored"
        conversions.append(f"{missing} of {mask.size} texels {what}")
    return Contents(
        layout="BDI",
        header=header,
        half=True,
        by_texel=True,
        memory=min(BLOCK_BYTES, header.texels * _texel_bytes(header)),
        pieces=partial(_pieces, header, stored, chunks, compression == _PACKED),
        conversions=conversions,
        details={"compression": f"{compression} ({_COMPRESSIONS[compression]})"},
    )


def _texel_bytes(header: Header) -> int:
    return header.pairs * header.channels * _HALF.itemsize


def _read_chunks(
    cursor: Cursor, header: Header, stored: int, most: int, packed: bool
) -> list[_Chunk]:
    """Pass over the chunks of `most` texels, of which only the last may have fewer."""
    chunks = []
    for number, first in enumerate(range(0, stored, most)):
        unpacked = min(most, stored - first) * _texel_bytes(header)
        size = cursor.u32(f"the size of chunk {number}")
        if not packed and size != unpacked:
            raise cursor.damaged(f"chunk {number} has {size} bytes, but its texels need {unpacked}")
        chunks.append(_Chunk(number, cursor.skip(size, f"chunk {number}"), size, unpacked))
    return chunks


def _pieces(
    header: Header, stored: np.ndarray, chunks: list[_Chunk], packed: bool, path: Path
) -> Generator[tuple[slice, np.ndarray]]:
    shape = (len(header.view), len(header.light), header.channels)
    # Large pieces, since each is scattered over all images of the dataset; spectral ones become
    # single precision on their way to RGB.
    most = 3 * BLOCK_BYTES // 2 if header.channels == 3 else BLOCK_BYTES // 2
    step = max(1, most // _texel_bytes(header))
    edges = [*range(0, header.texels, step), header.texels]
    try:
        with path.open("rb") as file:
            stream = _Stream(file, path.name, chunks, packed)
            for first, last in pairwise(edges):
                there = stored[first:last]
                values = np.zeros((last - first, *shape), _HALF)
                if there.all():
                    stream.read_into(values)
                else:
                    found = np.empty((int(there.sum()), *shape), _HALF)
                    stream.read_into(found)
                    values[there] = found
                yield slice(None), values.transpose(3, 2, 1, 0)
            stream.finish()
    except OSError as error:
        raise NacreError(f"cannot read {path}: {error.strerror}") from error


class _Stream:
    """The stored texels' bytes one after the other, whatever chunks they lie in."""

    def __init__(
        self, file: io.BufferedReader, name: str, chunks: list[_Chunk], packed: bool
    ) -> None:
        self._parts = self._packed(chunks) if packed else self._plain(chunks)
        self._file = file
        self._name = name
        self._wanted = memoryview(b"")

    def read_into(self, values: np.ndarray) -> None:
        """Fill a contiguous array."""
        if values.size == 0:
            return
        self._wanted = memoryview(values.reshape(-1).view(np.uint8))
        while self._wanted:
            # The chunks' sizes were found to add up to what is asked for.
            self._wanted = self._wanted[next(self._parts) :]

    def finish(self) -> None:
        """Check that nothing follows."""
        next(self._parts, None)

    def _plain(self, chunks: list[_Chunk]) -> Generator[int]:
        """Writes as much as possible where it is wanted; yields how much."""
        for chunk in chunks:
            self._file.seek(chunk.offset)
            left = chunk.bytes
            while left:
                count = self._file.readinto(self._wanted[:left])
                if not count:
                    raise NacreError(f"{self._name} was cut short while it was read")
                left -= count
                yield count

    def _packed(self, chunks: list[_Chunk]) -> Generator[int]:
        for chunk in chunks:
            problem = NacreError(
                f"{self._name} is damaged: chunk {chunk.number} is no bzip2 stream of "
                f"{chunk.unpacked} bytes"
            )
            self._file.seek(chunk.offset)
            packed, left = chunk.bytes, chunk.unpacked
            unpacker = bz2.BZ2Decompressor()
            while not unpacker.eof:
                data = b""
                if unpacker.needs_input:
                    data = self._file.read(min(packed, _READ_BYTES))
                    packed -= len(data)
                    if not data:
                        raise problem
                try:
                    # One byte too many shows that a stream is longer than it may be.
                    part = unpacker.decompress(data, min(len(self._wanted), left) or 1)
                except (OSError, ValueError) as error:
                    raise problem from error
                if len(part) > left:
                    raise problem
                left -= len(part)
                if part:
                    self._wanted[: len(part)] = part
                    yield len(part)
            if left or packed or unpacker.unused_data:
                raise problem
