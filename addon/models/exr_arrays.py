"""Named arrays and a description in one multi-part OpenEXR file that any EXR viewer opens.

An array of shape (a, ..., z) is one single-channel part, width z, height a * ..., HALF scaled to
peak 1 or UINT. The description is JSON in the string attribute `nacre`. It begins with a CRC-32 of
the whole file, because the OpenEXR library reads what it finds of a file cut short. Where
the first arrays of such a file are of use, each array and the description have their own as well.
"""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import secrets
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from ..errors import NacreError
from ..openexr import quiet

VERSION = 1
CHANNEL = "Y"  # luminance: viewers show a single channel of this name as grey

_MAGIC = b"\x76\x2f\x31\x01"
_ATTRIBUTE = b"nacre\0string\0"  # as a header spells it, before the size of the text and the text
_HEADER_BYTES = 4096  # the attribute begins within these: OpenEXR sorts attributes by name
_SEAL = b'{"crc32": "'
_UNSEALED = b"00000000"  # stands for the checksum where the checksum is computed

_SHARES = (0.125, 0.25, 0.5, 0.75)  # of a file, after which what has come in is looked at

_NO_ROOM = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)


def write_arrays(
    path: str | os.PathLike[str],
    arrays: Mapping[str, NDArray[Any]],
    axes: Mapping[str, list[str]],
    description: Mapping[str, object],
    partial: bool = False,
) -> None:
    """Write named arrays and their description to `path`, through a temporary name.

    With `partial`, so that the first ones can be read of a file that is cut short.

    Raises NacreError when the file cannot be written; then an older one is untouched.
    """
    path = check_destination(path)
    entries, images = {}, {}
    for name, array in arrays.items():
        scale = 1.0
        if np.issubdtype(array.dtype, np.floating):
            # Half floats end at 65504 and lose precision near 0: the peak goes into the scale.
            scale = float(np.float32(np.abs(array).max(initial=0.0))) or 1.0
            array = np.asarray(array / np.float32(scale), np.float16)
        images[name] = np.ascontiguousarray(array).reshape(-1, array.shape[-1])
        entries[name] = {
            "shape": list(array.shape),
            "axes": axes[name],
            "scale": scale,
        }
        if partial:
            entries[name]["crc32"] = _checksum_of(images[name].tobytes())
    seal = {"crc32": _UNSEALED.decode(), "nacre": VERSION}
    described = {**description, "arrays": entries}
    if partial:
        seal["description_crc32"] = _description_checksum(described)
    text = json.dumps({**seal, **described}, allow_nan=False)
    temporary = path.with_name(f".{path.stem}-{secrets.token_hex(4)}.exr")
    try:
        with quiet():  # beside a Blender that has OpenEXR as a shared library, it warns of nothing
            OpenEXR.File(_parts(images, text)).write(str(temporary))
        _check_written(temporary, images)
        _write_seal(temporary)
        os.replace(temporary, path)
    except (OSError, RuntimeError) as error:
        reason = " ".join(str(error).replace(str(temporary), path.name).split())
        if any(os.strerror(number) in reason for number in _NO_ROOM):
            raise NacreError(
                f"no room to write {path}: free space or choose another disk"
            ) from error
        raise NacreError(f"cannot write {path}: {reason}") from error
    finally:
        with contextlib.suppress(OSError):  # also where it never came to be
            temporary.unlink()


def read_arrays(
    path: str | os.PathLike[str], partial: bool = False
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """The arrays of a file at their own scale, float32 or uint32, and its description.

    With `partial`, those that are whole of a file that was cut short: the first ones.

    Raises NacreError when the file is missing, damaged, or not written by `write_arrays`.
    """
    if not is_model(path):
        raise NacreError(f"{path}: an OpenEXR picture, but not a model of Nacre's")
    intact = _is_intact(path)
    if not intact and not partial:
        raise _damaged(path)
    return _arrays(path, str(path), intact)


def read_growing(
    path: str | os.PathLike[str],
) -> Iterator[tuple[dict[str, NDArray[Any]], dict[str, Any]]]:
    """What `read_arrays` reads with `partial`, more of it each time, as a file of any length comes
    in: of an eighth, a quarter, half, three quarters and all of its bytes. Shares without any array
    are left out.

    Raises NacreError as `read_arrays` does, for what is wrong with the whole file at the end.
    """
    if not is_model(path):
        raise NacreError(f"{path}: an OpenEXR picture, but not a model of Nacre's")
    data = bytearray()
    with open(path, "rb") as file:
        size = os.fstat(file.fileno()).st_size
        for share in _SHARES:
            data += file.read(int(size * share) - len(data))
            try:
                found = _arrays(path, io.BytesIO(data), intact=False)
            except NacreError:
                continue
            yield found
    yield read_arrays(path, partial=True)


def _arrays(
    path: str | os.PathLike[str], source: str | io.BytesIO, intact: bool
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """The arrays that are found in a file or in its bytes; NacreError, naming `path`."""
    try:
        with quiet():
            parts = OpenEXR.File(source, separate_channels=True).parts
        description = json.loads(parts[0].header["nacre"])
        images = {part.name(): part.channels[CHANNEL].pixels for part in parts}
    except (RuntimeError, LookupError, ValueError) as error:
        raise _damaged(path) from error
    if description["nacre"] != VERSION:
        raise NacreError(
            f"{path}: is of file version {description['nacre']} and this Nacre reads version "
            f"{VERSION}: update the extension"
        )
    if not intact:
        images = _intact_images(path, images, description)
    arrays = {}
    for name, entry in description["arrays"].items():
        if name not in images:
            if not intact:
                continue
            raise NacreError(f"{path}: has no part {name!r}; compress the dataset again")
        array = images[name].reshape(entry["shape"])
        if array.dtype == np.float16:
            array = array.astype(np.float32) * np.float32(entry["scale"])
        arrays[name] = array
    return arrays, description


def read_description(path: str | os.PathLike[str]) -> dict[str, Any]:
    """What a file says of itself, also where arrays were cut off; NacreError as `read_arrays`."""
    if not is_model(path):
        raise NacreError(f"{path}: an OpenEXR picture, but not a model of Nacre's")
    try:
        with quiet():
            header = OpenEXR.File(str(path), header_only=True).parts[0].header
        description: dict[str, Any] = json.loads(header["nacre"])
    except (RuntimeError, LookupError, ValueError) as error:
        raise _damaged(path) from error
    return description


def is_model(path: str | os.PathLike[str]) -> bool:
    """Whether an EXR file carries Nacre's description; NacreError when it is no EXR file."""
    try:
        with open(path, "rb") as file:
            head = file.read(_HEADER_BYTES)
    except FileNotFoundError:
        raise NacreError(f"{path}: no such file") from None
    except OSError as error:
        raise NacreError(f"{path}: cannot be read ({error.strerror})") from error
    if not head.startswith(_MAGIC):
        raise NacreError(f"{path}: not an OpenEXR file")
    return _ATTRIBUTE in head


def read_picture(path: str | os.PathLike[str]) -> NDArray[np.float32]:
    """The pixels (height, width, 3) of an EXR picture, bottom row first.

    Raises NacreError when the file is missing, damaged, or not a colour picture.
    """
    is_model(path)
    try:
        with quiet():
            parts = OpenEXR.File(str(path)).parts
    except (RuntimeError, ValueError) as error:
        raise NacreError(f"{path}: cut short or damaged ({error})") from error
    if not parts:  # so the library says that some of the pixels are missing
        raise NacreError(f"{path}: cut short or damaged")
    for name in ("RGB", "RGBA"):
        if name in parts[0].channels:
            pixels = parts[0].channels[name].pixels[..., :3]
            return np.asarray(pixels, np.float32)[::-1]
    raise NacreError(f"{path}: not a colour picture")


def check_destination(path: str | os.PathLike[str]) -> Path:
    """Raise NacreError, before any work, for a name that cannot be written."""
    path = Path(path)
    if path.suffix.lower() != ".exr":
        raise NacreError(f"{path}: the name of a model ends in .exr")
    if not os.path.isdir(path.parent):
        raise NacreError(f"cannot write {path}: there is no folder {path.parent}")
    if os.path.isdir(path):
        raise NacreError(f"cannot write {path}: it is a folder")
    return path


def _parts(images: Mapping[str, NDArray[Any]], text: str) -> list[OpenEXR.Part]:
    """One part for each image; the first carries the description."""
    width = max(image.shape[1] for image in images.values())
    height = max(image.shape[0] for image in images.values())
    return [
        OpenEXR.Part(
            {
                "type": OpenEXR.scanlineimage,
                "compression": OpenEXR.ZIP_COMPRESSION,
                "displayWindow": _window(width, height),  # must be the same for all parts
                "dataWindow": _window(*image.shape[::-1]),
                **({"nacre": text} if index == 0 else {}),
            },
            {CHANNEL: image},
            name,
        )
        for index, (name, image) in enumerate(images.items())
    ]


def _window(width: int, height: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    return np.zeros(2, np.int32), np.array([width - 1, height - 1], np.int32)


def _check_written(path: Path, images: Mapping[str, NDArray[Any]]) -> None:
    """Raise OSError unless a file reads back as what was written: the OpenEXR library does not
    notice that a disk fills up while it closes the file."""
    parts = []
    with quiet(), contextlib.suppress(RuntimeError, ValueError):
        parts = OpenEXR.File(str(path), separate_channels=True).parts
    written = {part.name(): part.channels[CHANNEL].pixels for part in parts}
    for name, image in images.items():
        if name not in written or not np.array_equal(written[name], image):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _write_seal(path: Path) -> None:
    """Put a file's checksum into its description."""
    at, checksum = _checksum(path)
    with path.open("r+b") as file:
        file.seek(at)
        file.write(b"%08x" % checksum)


def _is_intact(path: str | os.PathLike[str]) -> bool:
    """Whether every byte of a sealed file is the one that was written."""
    try:
        at, checksum = _checksum(path)
        with open(path, "rb") as file:
            file.seek(at - len(_SEAL))
            if file.read(len(_SEAL)) != _SEAL:
                return True  # other programs that write EXR files do not know of the seal
            return file.read(len(_UNSEALED)) == b"%08x" % checksum
    except OSError as error:
        raise NacreError(f"{path}: cannot be read ({error.strerror})") from error


def _intact_images(
    path: str | os.PathLike[str],
    images: Mapping[str, NDArray[Any]],
    description: dict[str, Any],
) -> dict[str, NDArray[Any]]:
    """Those images of a damaged file that are as they were written."""
    described = dict(description)
    del described["crc32"], described["nacre"]
    if described.pop("description_crc32", None) != _description_checksum(described):
        raise _damaged(path)
    return {
        name: images[name]
        for name, entry in described["arrays"].items()
        if name in images and _checksum_of(images[name].tobytes()) == entry["crc32"]
    }


def _description_checksum(described: Mapping[str, Any]) -> str:
    return _checksum_of(json.dumps(described).encode())


def _checksum_of(content: bytes) -> str:
    """Always eight digits: the size of a file must not depend on what its checksums are."""
    return f"{zlib.crc32(content):08x}"


def _damaged(path: str | os.PathLike[str]) -> NacreError:
    return NacreError(f"{path}: cut short or damaged; copy it or compress the dataset again")


def _checksum(path: str | os.PathLike[str]) -> tuple[int, int]:
    """Where a file's checksum stands and what it must be."""
    data = np.memmap(path, np.uint8, "r")
    text = bytes(data[:_HEADER_BYTES]).index(_ATTRIBUTE) + len(_ATTRIBUTE) + 4
    at = text + len(_SEAL)
    checksum = zlib.crc32(data[:at])
    checksum = zlib.crc32(_UNSEALED, checksum)
    return at, zlib.crc32(data[at + len(_UNSEALED) :], checksum)
