"""Coefficients in few bytes: a value in one, and a position in less than two.

In the order of positions each of a patch's n has floor(log2(size / n)) low bits, which are kept as
they are, and high bits that never fall from one to the next: those are a row of bits, as many zeros
as the high bits rise, then a one for each coefficient (Elias 1974, Fano 1971). That makes at most
2 + log2(size / n) bits a position; their information is 1.44 + log2(size / n).
"""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import NDArray

_LEVELS_AN_OCTAVE = 10
_SMALLEST = 126  # the last of 127 magnitudes; with signs and zero these are 255


def value_bytes(values: NDArray[np.float32], largest: float) -> NDArray[np.uint8]:
    """Zero, or one of 127 magnitudes that fall by a tenth of an octave each from the largest on,
    with a sign. The error is 35 dB below what the coefficients hold."""
    magnitude = np.abs(values)
    with np.errstate(divide="ignore"):
        level = np.rint(-_LEVELS_AN_OCTAVE * np.log2(magnitude / np.float32(largest or 1.0)))
    level = np.clip(level, 0, _SMALLEST).astype(np.uint8) + np.uint8(1)
    level |= np.where(values < 0, np.uint8(128), np.uint8(0))
    return np.where(magnitude > 0, level, np.uint8(0))


def values_of(found: NDArray[np.uint8], largest: float) -> NDArray[np.float32]:
    """The values of `value_bytes`."""
    level = np.arange(-1, 127)
    table = np.float32(largest) * np.exp2(-level / _LEVELS_AN_OCTAVE).astype(np.float32)
    table[0] = 0.0
    return np.concatenate([table, -table])[found]


def pack(
    positions: NDArray[np.uint32], values: NDArray[np.float32], size: int, largest: float
) -> NDArray[np.uint32]:
    """Positions below `size` and values (n, patches) of rounded codes as words (patches, words)."""
    order = np.argsort(positions, 0, kind="stable")
    places = np.take_along_axis(positions, order, 0).T.astype(np.int64)
    count, low = places.shape[1], _low_bits(size, len(positions))
    bits = np.empty((*places.shape, low), np.uint8)
    for bit in range(low):
        bits[..., bit] = (places >> bit) & 1
    rows = np.zeros((len(places), _high_length(size, count, low)), np.uint8)
    np.put_along_axis(rows, (places >> low) + np.arange(count), 1, 1)
    parts = (
        value_bytes(np.take_along_axis(values, order, 0).T, largest),
        np.packbits(bits.reshape(len(places), -1), 1),
        np.packbits(rows, 1),
    )
    packed = np.concatenate(parts, 1)
    packed = np.pad(packed, ((0, 0), (0, -packed.shape[1] % 4)))
    return np.ascontiguousarray(packed).view("<u4").astype(np.uint32)


def unpack(
    words: NDArray[np.uint32], count: int, size: int, largest: float
) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """Positions and values (count, patches), the largest first, of what `pack` returned.

    Raises ValueError for what is not that."""
    packed = np.ascontiguousarray(words.astype("<u4")).view(np.uint8)
    low = _low_bits(size, count)
    ends = np.cumsum([count, ceil(count * low / 8), ceil(_high_length(size, count, low) / 8)])
    if packed.shape[1] != ends[-1] + -ends[-1] % 4:
        raise ValueError("not so many coefficients")
    found, bits, rows, _ = np.split(packed, ends, 1)
    bits = np.unpackbits(bits, 1, count=count * low).reshape(len(packed), count, low)
    rows = np.unpackbits(rows, 1, count=_high_length(size, count, low))
    if (rows.sum(1) != count).any():
        raise ValueError("not so many coefficients")
    places = np.nonzero(rows)[1].reshape(len(packed), count) - np.arange(count)
    places <<= low
    for bit in range(low):
        places |= bits[..., bit].astype(np.int64) << bit
    if places.max(initial=0) >= size:
        raise ValueError("a position beyond the patch")
    values = values_of(found, largest)
    order = np.argsort(-np.abs(values), 1, kind="stable")
    places = np.take_along_axis(places, order, 1)
    values = np.take_along_axis(values, order, 1)
    return places.T.astype(np.uint32), np.ascontiguousarray(values.T)


def _low_bits(size: int, count: int) -> int:
    return max(0, (size // count).bit_length() - 1)


def _high_length(size: int, count: int, low: int) -> int:
    """A one for each coefficient, and no more zeros than the highest position has high bits for."""
    return count + ((size - 1) >> low)
