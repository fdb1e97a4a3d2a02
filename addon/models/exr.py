"""Models as multi-part OpenEXR files that any EXR viewer opens.

One single-channel part for each array; the description is JSON in the string attribute `nacre`.
"""

from __future__ import annotations

import json
import os
import secrets
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from ..errors import NacreError
from .clustered_tucker import MODES, ClusteredTucker

VERSION = 1
MULTI_PART = 0x10  # in the second byte of an EXR file's version field
CHANNEL = "Y"  # luminance: viewers show a single channel of this name as grey


def save_model(model: ClusteredTucker, path: str | os.PathLike[str]) -> None:
    """Write a model to `path`, through a temporary name; NacreError when it cannot be written."""
    axes = {"core": ["cluster", *MODES]}
    arrays: dict[str, NDArray[Any]] = {"core": model.core}
    for mode in MODES:
        arrays[f"basis_{mode}"] = model.bases[mode]
        axes[f"basis_{mode}"] = ["owner", mode, "mixture", "rank"]
    for mode, members in model.members.items():
        arrays[f"members_{mode}"] = members
        axes[f"members_{mode}"] = [mode, "mixture"]
    description = {
        "nacre": VERSION,
        "kind": "btf",
        "model": "clustered-tucker",
        "modes": list(MODES),
        "clusters": dict(model.clusters),
        "dataset": dict(model.dataset),
        "fit": dict(model.fit),
    }
    write_arrays(path, arrays, axes, description)


def load_model(path: str | os.PathLike[str]) -> ClusteredTucker:
    """Read a model; NacreError when the file is missing, damaged or not a model of Nacre's."""
    arrays, description = read_arrays(path)
    if description.get("model") != "clustered-tucker":
        raise NacreError(f"{path}: holds a {description.get('model')!r} model, which is not known here")
    try:
        model = ClusteredTucker(
            core=arrays["core"],
            bases={mode: arrays[f"basis_{mode}"] for mode in MODES},
            members={mode: arrays[f"members_{mode}"] for mode in description["clusters"]},
            clusters=description["clusters"],
            dataset=description["dataset"],
            fit=description["fit"],
        )
        lights, views, _, _, _ = model.shape
        counts = len(model.dataset["light"]), len(model.dataset["view"])  # type: ignore[arg-type]
    except (KeyError, TypeError) as error:
        raise NacreError(f"{path}: a part of the model is missing ({error})") from error
    if counts != (lights, views):
        raise NacreError(f"{path}: {counts} directions for {(lights, views)} lights and views")
    return model


def write_arrays(
    path: str | os.PathLike[str],
    arrays: Mapping[str, NDArray[Any]],
    axes: Mapping[str, list[str]],
    description: Mapping[str, object],
) -> None:
    """Write named arrays, floats as HALF scaled to peak 1 and indices as UINT, and a description.

    An array of shape (a, ..., z) becomes one part of width z and height a * ... .
    """
    entries, images = {}, {}
    for name, array in arrays.items():
        scale = 1.0
        if np.issubdtype(array.dtype, np.floating):
            # Half floats end at 65504 and lose precision near 0: the peak goes into the scale.
            scale = float(np.float32(np.abs(array).max(initial=0.0))) or 1.0
            array = np.asarray(array / np.float32(scale), np.float16)
        image = np.ascontiguousarray(array).reshape(-1, array.shape[-1])
        images[name] = image
        entries[name] = {
            "shape": list(array.shape),
            "axes": axes[name],
            "scale": scale,
            "crc32": zlib.crc32(image.tobytes()),
        }
    text = json.dumps({**description, "arrays": entries})
    width = max(image.shape[1] for image in images.values())
    height = max(image.shape[0] for image in images.values())
    parts = [
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
    path = Path(path)
    if not path.parent.is_dir():
        raise NacreError(f"{path.parent}: no such folder; make it first")
    temporary = path.with_name(f".{path.stem}-{secrets.token_hex(4)}.exr")
    try:
        OpenEXR.File(parts).write(str(temporary))
        _check_complete(temporary)
        os.replace(temporary, path)
    except (OSError, RuntimeError, NacreError) as error:
        raise NacreError(
            f"{path}: could not be written ({_reason(error, path.parent)}); nothing was left behind"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def read_arrays(
    path: str | os.PathLike[str],
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """The arrays of a file at their own scale, float32 or uint32, and its description."""
    _check_complete(path)
    try:
        parts = OpenEXR.File(str(path), separate_channels=True).parts
        text = parts[0].header.get("nacre")
        images = {part.name(): part.channels[CHANNEL].pixels for part in parts}
    except (RuntimeError, KeyError) as error:
        raise NacreError(f"{path}: cannot be read as OpenEXR ({error})") from error
    if text is None:
        raise NacreError(f"{path}: an OpenEXR picture, but not a model of Nacre's")
    description = json.loads(text)
    if description.get("nacre") != VERSION:
        raise NacreError(
            f"{path}: file version {description.get('nacre')}, this Nacre reads version {VERSION}"
        )
    arrays = {}
    for name, entry in description["arrays"].items():
        image = images.get(name)
        if image is None or zlib.crc32(np.ascontiguousarray(image).tobytes()) != entry["crc32"]:
            raise NacreError(f"{path}: part {name!r} is damaged; compress the dataset again")
        array = image.reshape(entry["shape"])
        if array.dtype == np.float16:
            array = array.astype(np.float32) * np.float32(entry["scale"])
        arrays[name] = array
    return arrays, description


def is_model(path: str | os.PathLike[str]) -> bool:
    """Whether an EXR file carries Nacre's description; NacreError when it is no EXR file."""
    _check_complete(path)
    try:
        return "nacre" in OpenEXR.File(str(path), header_only=True).parts[0].header
    except RuntimeError as error:
        raise NacreError(f"{path}: cannot be read as OpenEXR ({error})") from error


def read_picture(path: str | os.PathLike[str]) -> NDArray[np.float32]:
    """The pixels (height, width, 3) of an EXR picture, bottom row first."""
    _check_complete(path)
    try:
        channels = OpenEXR.File(str(path)).channels()
        pixels = (channels.get("RGB") or channels["RGBA"]).pixels[..., :3]
    except (RuntimeError, KeyError) as error:
        raise NacreError(f"{path}: not a colour picture ({error})") from error
    return np.asarray(pixels, np.float32)[::-1]


def _window(width: int, height: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    return np.zeros(2, np.int32), np.array([width - 1, height - 1], np.int32)


def _reason(error: Exception, folder: Path) -> str:
    """Why a write failed; the OpenEXR library does not pass the system's reason on."""
    status = os.statvfs(folder) if hasattr(os, "statvfs") else None
    if status is not None and status.f_bavail * status.f_frsize < 1 << 20:
        return "the disk is full"
    return str(error) or type(error).__name__


def _check_complete(path: str | os.PathLike[str]) -> None:
    """Raise NacreError unless `path` is an EXR file that, when it has several parts as models have,
    ends just where its last chunk ends.

    The OpenEXR library reads what is there of a file cut short and only warns.
    """
    try:
        data = np.memmap(path, np.uint8, "r")
    except FileNotFoundError:
        raise NacreError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise NacreError(f"{path}: cannot be read ({error})") from error
    if bytes(data[:4]) != b"\x76\x2f\x31\x01":
        raise NacreError(f"{path}: not an OpenEXR file, so not a model")
    if len(data) < 8 or not data[5] & MULTI_PART:
        return  # a plain picture
    try:
        if _last_byte(data) != len(data):
            raise ValueError
    except (ValueError, IndexError, struct.error) as error:
        raise NacreError(f"{path}: cut short or damaged; copy or compress it again") from error


def _last_byte(data: NDArray[np.uint8]) -> int:
    """Where the last chunk of a multi-part EXR file ends, by its headers and offset tables."""

    def string(at: int) -> tuple[bytes, int]:
        end = bytes(data[at : at + 256]).index(b"\0")
        return bytes(data[at : at + end]), at + end + 1

    def number(layout: str, at: int) -> int:
        return int(struct.unpack(layout, bytes(data[at : at + struct.calcsize(layout)]))[0])

    at, chunks = 8, 0
    while data[at]:  # each header is a list of attributes ended by a zero, and so is their list
        while data[at]:
            name, at = string(at)
            _, at = string(at)
            size = number("<i", at)
            if name == b"chunkCount":
                chunks += number("<i", at + 4)
            at += 4 + size
            if size < 0 or at >= len(data):
                raise ValueError
        at += 1
    table = np.frombuffer(bytes(data[at + 1 : at + 1 + 8 * chunks]), "<u8")
    if len(table) != chunks:
        raise ValueError
    last = int(table.max(initial=0))  # a chunk: part, y, size, bytes
    return last + 12 + number("<i", last + 8)
