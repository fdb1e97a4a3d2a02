"""Radiance .hdr pictures: three mantissas and one exponent, run-length encoded or flat.

After the file format's description in Ward, "Real Pixels" (Graphics Gems II) and the Radiance
reference manual; a mantissa is taken as it is, without the half step that Radiance's own tools add.
"""

import re

import numpy as np

from ...errors import NacreError
from .size import check_claim

MAGIC = b"#?"

_FORMATS = {"32-bit_rle_rgbe": "RGB", "32-bit_rle_xyze": "XYZ"}
_SIZE = re.compile(rb"([+-][XY]) +(\d{1,9}) +([+-][XY]) +(\d{1,9})")
_MOST_HEADER = 2**16
# Widths of scanlines that may be encoded channel by channel.
_SHORTEST, _LONGEST = 8, 0x7FFF


def read(data: bytes, name: str) -> tuple[np.ndarray, str, tuple[str, ...]]:
    """Pixels (row, column, channel) float32, top row first, "RGB" or "XYZ", and notes.

    Exposure and colour correction that the header says were multiplied in are divided out. Raises
    NacreError for a damaged or cut file and for an orientation other than rows from left to right.
    """
    lines, at = _header(data, name)
    bands, exposure = _variables(lines, name)
    width, height, upward = _size(lines[-1], name)
    check_claim(name, width, height, 4, len(data))
    rows = bytearray()
    for _ in range(height):
        row, at = _scanline(data, at, width, name)
        rows += row
    rgbe = np.frombuffer(rows, np.uint8).reshape(height, width, 4)
    scale = np.ldexp(np.float32(1), np.arange(256) - 136).astype(np.float32)
    scale[0] = 0  # black, whatever the mantissas
    pixels = rgbe[..., :3] * scale[rgbe[..., 3:]]
    notes: tuple[str, ...] = ()
    if (exposure != 1).any():
        with np.errstate(over="ignore"):
            pixels = (pixels / exposure).astype(np.float32)
        notes = (f"divided by the exposure in the images' headers, {_text(exposure)} in the first",)
    return pixels[::-1] if upward else pixels, bands, notes


def _header(data: bytes, name: str) -> tuple[list[bytes], int]:
    """The lines up to the picture's size, which comes after an empty one, and where pixels are."""
    empty = data.find(b"\n\n", 0, _MOST_HEADER)
    end = data.find(b"\n", empty + 2, _MOST_HEADER) if empty >= 0 else -1
    if end < 0:
        raise NacreError(f"{name} is no whole Radiance picture: its header has no end")
    return [*data[:empty].split(b"\n"), data[empty + 2 : end]], end + 1


def _variables(lines: list[bytes], name: str) -> tuple[str, np.ndarray]:
    """The bands, and the exposure (3,) times colour correction that was multiplied in."""
    bands = "RGB"
    exposure = np.ones(3)
    for line in lines[1:-1]:
        key, _, value = line.decode("latin-1").partition("=")
        try:
            if key == "FORMAT":
                bands = _FORMATS[value.strip()]
            elif key == "EXPOSURE":
                exposure *= float(value)
            elif key == "COLORCORR":
                red, green, blue = (float(part) for part in value.split())
                exposure *= red, green, blue
        except (KeyError, ValueError):
            raise NacreError(f"{name} has the unknown {key} {value.strip()!r}") from None
    if not (np.isfinite(exposure).all() and (exposure > 0).all()):
        raise NacreError(f"{name} has the exposure {_text(exposure)}")
    return bands, exposure


def _text(exposure: np.ndarray) -> str:
    values = exposure[:1] if (exposure == exposure[0]).all() else exposure
    return " ".join(f"{value:g}" for value in values)


def _size(line: bytes, name: str) -> tuple[int, int, bool]:
    """(width, height, whether the first row is the bottom one)."""
    found = _SIZE.fullmatch(line.strip())
    axes = found and (found[1], found[3])
    if found is None or axes not in {(b"-Y", b"+X"), (b"+Y", b"+X"), (b"+X", b"-Y")}:
        shown = line[:40].decode("latin-1")
        raise NacreError(f"{name} has the size {shown!r}; expected one like -Y 256 +X 256")
    first, second = int(found[2]), int(found[4])
    if axes == (b"+X", b"-Y"):
        # Columns from top to bottom, if taken by the letter. Only the ATRIUM BTFs are known to have
        # it, and the one other reader of these takes them for rows from bottom to top.
        return first, second, True
    return second, first, axes == (b"+Y", b"+X")


def _scanline(data: bytes, at: int, width: int, name: str) -> tuple[bytes, int]:
    """A row's RGBE pixels, and where the next one begins."""
    if len(data) < at + 4:
        raise _cut(name)
    if _SHORTEST <= width <= _LONGEST and data[at : at + 2] == b"\2\2" and data[at + 2] < 128:
        if data[at + 2] * 256 + data[at + 3] != width:
            raise NacreError(f"{name} is damaged: a row of another width than the picture's")
        return _by_channel(data, at + 4, width, name)
    flat = data[at : at + 4 * width]
    if b"\1\1\1" not in flat:  # no repeats
        if len(flat) < 4 * width:
            raise _cut(name)
        return flat, at + 4 * width
    return _by_pixel(data, at, width, name)


def _by_channel(data: bytes, at: int, width: int, name: str) -> tuple[bytes, int]:
    row = bytearray(4 * width)
    for channel in range(4):
        values = bytearray()
        while len(values) < width:
            if len(data) < at + 2:
                raise _cut(name)
            count = data[at]
            if count > 128:
                values += data[at + 1 : at + 2] * (count - 128)
                at += 2
            elif count > 0:
                values += data[at + 1 : at + 1 + count]
                at += 1 + count
            else:
                raise NacreError(f"{name} is damaged: a run of no length")
            if at > len(data):
                raise _cut(name)
        if len(values) != width:
            raise NacreError(f"{name} is damaged: a run goes beyond its row")
        row[channel::4] = values
    return bytes(row), at


def _by_pixel(data: bytes, at: int, width: int, name: str) -> tuple[bytes, int]:
    """The older encoding: a pixel 1, 1, 1, n repeats the one before n times; several in a row are
    the bytes of one larger n, the lowest first."""
    row = bytearray()
    shift = 0
    while len(row) < 4 * width:
        pixel = data[at : at + 4]
        if len(pixel) < 4:
            raise _cut(name)
        at += 4
        if pixel[:3] != b"\1\1\1":
            row += pixel
            shift = 0
            continue
        count = pixel[3] << shift
        shift += 8
        if not row or len(row) + 4 * count > 4 * width:
            raise NacreError(f"{name} is damaged: a run goes beyond its row")
        row += row[-4:] * count
    return bytes(row), at


def _cut(name: str) -> NacreError:
    return NacreError(f"{name} is cut short: pixels are missing")
