"""The dataset folder `NAME.nacre`: `samples.npy` and `dataset.json`, opened without loading them.

A BTF has the axes (light, view, y, x, channel), y growing upward. Values are linear Rec.709:
outgoing radiance over that of a white perfect diffuser lit head-on by the same light. Occlusion has
the axes (view, y, x); its values are masks or signed distances, and `occlusion` says which sign is
covered. Samples are float16 or float32 in C order.
"""

import errno
import json
import math
import os
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import DTypeLike

from ..errors import NacreError

AXES = ("light", "view", "y", "x", "channel")
"""The axes of a BTF."""

KINDS = {"btf": AXES, "occlusion": ("view", "y", "x")}
"""The axes of each kind of dataset."""

VALUES = ("mask", "signed-distance")
"""What the samples of occlusion may be."""

DTYPES = (np.dtype("<f2"), np.dtype("<f4"))
DESCRIPTION = "dataset.json"
SAMPLES = "samples.npy"

_NO_ROOM = {errno.ENOSPC, errno.EFBIG, errno.EDQUOT}


class HalfOverflowError(NacreError):
    """A finite value beyond 65504 was written to float16 samples."""


@dataclass(frozen=True, eq=False)
class Dataset:
    """A dataset on disk.

    light (L, 3) and view (V, 3) are float64 unit vectors away from the surface; patch_size is
    (width, height) in metres; samples is a read-only memory map of float16 or float32 with the axes
    of the kind; source is {"format", "file", "conversions"}; side_channels are names of pictures
    (y, x) beside the samples, NAME.exr. What a kind lacks is empty: light (0, 3) and channels of
    occlusion, value of a BTF.
    """

    path: Path
    kind: str
    axes: tuple[str, ...]
    light: np.ndarray
    view: np.ndarray
    channels: tuple[str, ...]
    value: str
    patch_size: tuple[float, float]
    periodic: bool
    noise_floor_db: float | None
    source: dict[str, Any]
    side_channels: tuple[str, ...]
    samples: np.ndarray

    @property
    def shape(self) -> tuple[int, ...]:
        return self.samples.shape

    @property
    def sizes(self) -> dict[str, int]:
        """The length of each axis."""
        return dict(zip(self.axes, self.samples.shape, strict=True))

    @property
    def raw_bytes(self) -> int:
        """Size of the samples as float32, the size that compression is measured against."""
        return 4 * math.prod(self.samples.shape)


def open_dataset(path: str | Path) -> Dataset:
    """Open a dataset folder; the samples are mapped, not read.

    Raises NacreError when there is none, when dataset.json is not what this version writes, when
    it does not fit samples.npy, and when samples.npy is cut short.
    """
    path = Path(path)
    if not os.path.exists(path):
        raise NacreError(f"there is no dataset {path}")
    try:
        text = (path / DESCRIPTION).read_text(encoding="utf-8")
    except OSError as error:
        raise NacreError(f"{path} is not a Nacre dataset: it has no {DESCRIPTION}") from error
    except UnicodeDecodeError as error:
        raise NacreError(f"{path.name}: {DESCRIPTION} is not UTF-8 text") from error
    try:
        description = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise NacreError(f"{path.name}: {DESCRIPTION} is not JSON: {error}") from error
    try:
        samples = _map_samples(path / SAMPLES)
    except OSError as error:
        raise NacreError(f"{path.name}: cannot read {SAMPLES}: {error.strerror}") from error
    fields = _check_description(description, samples.shape, path.name)
    return Dataset(path=path, samples=samples, **fields)


class DatasetWriter:
    """Writes a dataset block by block; a context manager.

    Samples go to a temporary folder beside `path`, which takes the place of `path` (also of an
    older dataset there) when the block ends without an error; otherwise nothing is left.
    `description` is the content of dataset.json, `shape` the length of each of its axes, `dtype`
    float16 or float32. Raises NacreError when the folder cannot be written or the disk is full.
    """

    def __init__(
        self,
        path: str | Path,
        description: dict[str, Any],
        shape: tuple[int, ...],
        dtype: DTypeLike,
    ) -> None:
        self.path = Path(path)
        self.shape = tuple(int(size) for size in shape)
        self.dtype = np.dtype(dtype).newbyteorder("<")
        if self.dtype not in DTYPES:
            raise ValueError(f"dtype: expected float16 or float32, found {self.dtype}")
        self._axes = _check_description(description, self.shape, self.path.name)["axes"]
        self._description = description
        self._total = math.prod(self.shape)
        self._written = 0
        self._partial = self.path.parent / f".{self.path.name}.{secrets.token_hex(4)}.partial"
        self._file: BinaryIO | None = None
        self._start = 0

    @property
    def fraction(self) -> float:
        """How much of the samples has been written, in [0, 1]."""
        return self._written / self._total

    def __enter__(self) -> "DatasetWriter":
        with self._disk_errors():
            check_destination(self.path)
            if shutil.disk_usage(self.path.parent).free < self._total * self.dtype.itemsize:
                raise OSError(errno.ENOSPC, "no room")
            self._partial.mkdir()
        try:
            with self._disk_errors():
                self._file = (self._partial / SAMPLES).open("wb")
                header = {
                    "descr": np.lib.format.dtype_to_descr(self.dtype),
                    "fortran_order": False,
                    "shape": self.shape,
                }
                np.lib.format.write_array_header_1_0(self._file, header)
                self._start = self._file.tell()
        except BaseException:
            self._discard()
            raise
        return self

    def write(self, array: np.ndarray) -> None:
        """Append the next samples in C order, in an array of any shape.

        Raises HalfOverflowError for a value that float16 cannot hold, NacreError for one that is
        not finite.
        """
        first = self._written
        stored = self._stored(array, lambda offset: first + offset)
        assert self._file is not None
        with self._disk_errors():
            self._file.write(stored.reshape(-1).data)
        self._written += stored.size

    def write_texels(self, array: np.ndarray) -> None:
        """Write the next texels of all lights and views: (light, view, texel, channel).

        For files that are stored texel by texel; do not mix with `write`, whose errors it raises.
        """
        images, texels = math.prod(self.shape[:-3]), math.prod(self.shape[-3:-1])
        channels = self.shape[-1]
        first, count = self._written // (images * channels), array.shape[-2]

        def place(offset: int) -> int:
            image, inside = divmod(offset, count * channels)
            return (image * texels + first) * channels + inside

        stored = self._stored(array, place)
        size = self.dtype.itemsize
        assert self._file is not None
        with self._disk_errors():
            for image, part in enumerate(stored.reshape(images, -1)):
                self._file.seek(self._start + place(image * count * channels) * size)
                self._file.write(part.data)
        self._written += stored.size

    def _stored(self, array: np.ndarray, place: Callable[[int], int]) -> np.ndarray:
        """The samples as they are written; `place` says where in the dataset each of them goes."""
        block = np.ascontiguousarray(array)
        if self._file is None or self._written + block.size > self._total:
            raise ValueError(f"array: more samples than the dataset's shape {self.shape} holds")
        with np.errstate(over="ignore", invalid="ignore"):
            stored = block.astype(self.dtype, copy=False)
        if not np.isfinite(stored).all():
            raise self._value_error(block, stored, place)
        return stored

    def add_files(self, write: Callable[[Path], None]) -> None:
        """Let `write` put more files into the dataset's folder."""
        with self._disk_errors():
            write(self._partial)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if kind is None:
                self._finish()
        finally:
            self._discard()

    def _finish(self) -> None:
        if self._written != self._total:
            raise ValueError(f"{self._written} of {self._total} samples were written")
        text = json.dumps(self._description, allow_nan=False)
        assert self._file is not None
        with self._disk_errors():
            self._file.close()
            (self._partial / DESCRIPTION).write_text(text + "\n", encoding="utf-8")
            _move_into_place(self._partial, self.path)

    def _discard(self) -> None:
        """Remove the temporary folder; after a successful move there is none."""
        if self._file is not None:
            # Closing flushes, and so may meet the full disk a second time.
            with suppress(OSError):
                self._file.close()
        shutil.rmtree(self._partial, ignore_errors=True)

    def _value_error(
        self, block: np.ndarray, stored: np.ndarray, place: Callable[[int], int]
    ) -> NacreError:
        offset = int(np.argmin(np.isfinite(stored).reshape(-1)))
        index = np.unravel_index(place(offset), self.shape)
        where = ", ".join(f"{axis} {i}" for axis, i in zip(self._axes, index, strict=True))
        value = block.reshape(-1)[offset]
        if np.isfinite(value):
            return HalfOverflowError(
                f"{self.path.name}: the value {value:g} at {where} is too large for half floats"
            )
        return NacreError(f"{self.path.name}: the value at {where} is not a finite number")

    @contextmanager
    def _disk_errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if error.errno in _NO_ROOM:
                size = self._total * self.dtype.itemsize / 1e6
                raise NacreError(
                    f"no room to write {self.path} ({size:.1f} MB): free space or choose another "
                    "disk"
                ) from error
            raise NacreError(f"cannot write {self.path}: {error.strerror}") from error


def check_destination(path: str | Path) -> Path:
    """Raise NacreError where a dataset cannot be written or would replace something else."""
    path = Path(path)
    if not path.name:
        raise NacreError(f"{path} is no name for a dataset")
    if not path.parent.is_dir():
        raise NacreError(f"cannot write {path}: there is no folder {path.parent}")
    if not os.path.lexists(path):
        return path
    if path.is_dir() and ((path / DESCRIPTION).is_file() or not any(path.iterdir())):
        return path
    raise NacreError(f"{path} exists and is not a Nacre dataset: choose another name")


def _move_into_place(partial: Path, path: Path) -> None:
    """Rename `partial` to `path`; an older dataset there is removed only once this is done."""
    old = partial.with_suffix(".old")
    replaces = path.exists()
    if replaces:
        path.rename(old)
    try:
        partial.rename(path)
    except OSError:
        if replaces:
            old.rename(path)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _map_samples(path: Path) -> np.ndarray:
    """Map samples.npy read-only, once its header and its size have been found to agree."""
    with path.open("rb") as file:
        try:
            version = np.lib.format.read_magic(file)
            if version != (1, 0):
                raise ValueError(f"npy version {version}")
            shape, fortran_order, dtype = np.lib.format.read_array_header_1_0(file)
        except Exception as error:  # numpy lets its tokenizer's errors through
            raise NacreError(f"{path.parent.name}: {SAMPLES} has a damaged header") from error
        start = file.tell()
        size = os.fstat(file.fileno()).st_size
    if fortran_order or dtype not in DTYPES:
        raise NacreError(f"{path.parent.name}: {SAMPLES} is not float16 or float32 in C order")
    if min(shape, default=0) < 1:
        raise NacreError(f"{path.parent.name}: {SAMPLES} has shape {shape}, which holds nothing")
    expected = start + math.prod(shape) * dtype.itemsize
    if size < expected:
        raise NacreError(
            f"{path.parent.name}: {SAMPLES} is cut short ({size} of {expected} bytes); import again"
        )
    if size > expected:
        raise NacreError(
            f"{path.parent.name}: {SAMPLES} has {size - expected} bytes too many; import again"
        )
    return np.memmap(path, dtype=dtype, mode="r", offset=start, shape=shape)


def _check_description(description: Any, shape: tuple[int, ...], name: str) -> dict[str, Any]:
    """The Dataset's fields out of dataset.json's content; NacreError when it breaks the layout."""

    def require(condition: bool, problem: str) -> None:
        if not condition:
            raise NacreError(f"{name}: {DESCRIPTION} {problem}")

    require(isinstance(description, dict), "does not hold a JSON object")
    require("nacre" in description, "has no version under nacre")
    require(description["nacre"] == 1, "was written by a newer Nacre: update the extension")
    kind = description.get("kind")
    kinds = ", ".join(KINDS)
    require(isinstance(kind, str) and kind in KINDS, f"is of the kind {kind!r}: expected {kinds}")
    axes = KINDS[kind]
    keys = _KEYS | _OWN_KEYS[kind]
    missing = keys - description.keys()
    require(not missing, f"lacks {', '.join(sorted(missing))}")
    require(description["axes"] == list(axes), f"has other axes than {', '.join(axes)}")
    light, view = (
        _directions(description, axis, name) if axis in keys else np.zeros((0, 3))
        for axis in ("light", "view")
    )
    channels = description["channels"] if "channels" in keys else []
    require(
        isinstance(channels, list) and all(isinstance(channel, str) for channel in channels),
        "has channels that are not names",
    )
    listed = {"light": len(light), "view": len(view), "channel": len(channels)}
    listed = {axis: count for axis, count in listed.items() if axis in axes}
    sizes = dict(zip(axes, shape, strict=False))
    require(
        len(shape) == len(axes) and all(sizes[axis] == count for axis, count in listed.items()),
        f"lists {', '.join(f'{count} {axis}s' for axis, count in listed.items())}, but the samples "
        f"have shape {shape}",
    )
    value = description["value"] if "value" in keys else ""
    require(
        "value" not in keys or value in VALUES,
        f"has the value {value!r}: expected {' or '.join(VALUES)}",
    )
    patch = description["patch_size"]
    require(
        isinstance(patch, list) and len(patch) == 2 and all(_is_number(p) and p > 0 for p in patch),
        "has a patch_size that is not two lengths in metres",
    )
    require(isinstance(description["periodic"], bool), "has a periodic that is not true or false")
    noise = description["noise_floor_db"]
    require(noise is None or _is_number(noise), "has a noise_floor_db that is not a number")
    require(isinstance(description["source"], dict), "has a source that is not an object")
    side = description.get("side_channels", [])
    require(
        isinstance(side, list) and all(isinstance(n, str) and n.isidentifier() for n in side),
        "has side_channels that are not names",
    )
    return {
        "kind": kind,
        "axes": axes,
        "light": light,
        "view": view,
        "channels": tuple(channels),
        "value": value,
        "patch_size": (float(patch[0]), float(patch[1])),
        "periodic": description["periodic"],
        "noise_floor_db": noise,
        "source": description["source"],
        "side_channels": tuple(side),
    }


_KEYS = {"kind", "axes", "patch_size", "periodic", "noise_floor_db", "source"}
_OWN_KEYS = {"btf": {"light", "view", "channels"}, "occlusion": {"view", "value"}}


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _directions(description: dict[str, Any], axis: str, name: str) -> np.ndarray:
    """An axis's directions (n, 3) float64, read-only; NacreError when they are anything else."""
    try:
        vectors = np.array(description[axis], np.float64)
        if vectors.shape != (len(vectors), 3):
            raise ValueError
        # Not "above": a comparison with NaN is false.
        if not np.abs(np.linalg.norm(vectors, axis=1) - 1).max() <= 1e-3:
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        raise NacreError(
            f"{name}: {DESCRIPTION} has {axis} directions that are not unit vectors"
        ) from None
    vectors.flags.writeable = False
    return vectors
