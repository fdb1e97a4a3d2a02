"""UBO2014 `.btf` files: the decorrelated full matrix factorisation (DFMF) of the Bonn database.

Reads all header versions (1 to 4), half, float and double scalars, and the colour models 0, 9, 11
and 12, as the reference implementation (University of Bonn, btflib) defines them.

For each colour channel the file holds U and SxV with value = U[row] . SxV[column], where
row = view * lights + light and column = y * width + x. A transposed file holds the texels in U and
the directions in SxV; it is recognised by its matrices' sizes. When there are as many texels as
pairs of directions, sizes cannot tell, and the file is taken to be the usual, not transposed, kind
(btflib does the same). Row 0 of an image is its bottom row, so storage order is Nacre's order.
"""

import io
import math
import struct
from collections.abc import Generator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ..errors import NacreError
from .directions import is_above_horizon, spherical_to_unit
from .options import Options
from .source import BLOCK_BYTES, DEFAULT_PATCH_WIDTH, Source, assumed_patch_size

FORMAT = "btf"
EXTENSIONS = (".btf",)
OPTIONS = frozenset({"cosine"})

# Signature: whether rotations of local frames follow the image size.
_DFMF = {b"!DFMF08FCR": True, b"!DFMF08FC": False}
_OTHERS = {
    b"!FMF12FCER": "FMF",
    b"!FMF06FCR": "FMF",
    b"!FMF06FC": "FMF",
    b"!PVF06FCR": "PVF",
    b"!PVF06FC": "PVF",
    b"!BDIF06R2!": "BDI",
}
_LONGEST = 10

_COLOUR_MODELS = {0: "RGB", 9: "log Y, U, V", 11: "log Y, U/Y, V/Y", 12: "log RGB"}
_OTHER_MODELS = {
    1: "YUV",
    2: "Lab",
    3: "PCA",
    4: "YCoCg",
    5: "spectral",
    6: "spectral linear",
    10: "log Y, signed log U, V",
}
_LOG_OFFSET = np.float32(1e-5)

_SCALARS: dict[int, np.dtype] = {2: np.dtype("<f2"), 4: np.dtype("<f4"), 8: np.dtype("<f8")}
_CHANNELS = 3


@dataclass(frozen=True)
class _Matrix:
    """Where one factor lies in the file: rows x components scalars, row by row."""

    name: str
    offset: int
    rows: int
    components: int
    scalar: np.dtype


@dataclass(frozen=True)
class _Meta:
    version: int
    pixels_per_mm: float
    cosine_flag: int | None
    channel_order: list[int]


@dataclass(frozen=True)
class _Header:
    """Everything but the factors; `directions` and `texels` have one matrix a channel, in RGB."""

    meta: _Meta
    light: np.ndarray
    view: np.ndarray
    width: int
    height: int
    rotated: bool
    colour_model: int
    directions: list[_Matrix]
    texels: list[_Matrix]
    bytes: int


def matches(path: Path) -> bool:
    """Whether the file starts with any of Bonn's signatures, also those not supported."""
    return _signature(_first_bytes(path)) is not None


def open_source(path: Path, options: Options) -> Source:
    """Read everything but the factors, and check every size against the file's.

    Raises NacreError, one line, for anything that is not a whole and consistent DFMF file.
    """
    try:
        with path.open("rb") as file:
            header = _read_header(file, path)
    except OSError as error:
        raise NacreError(f"cannot read {path}: {error.strerror}") from error
    scaled, conversions = _cosine(header.meta, options.cosine, path.name)
    if header.colour_model != 0:
        name = _COLOUR_MODELS[header.colour_model]
        conversions.append(f"colour model {header.colour_model} ({name}) decoded to RGB")
    if header.rotated:
        conversions.append("rotations of local frames left out")
    patch_size = _patch_size(header)
    if patch_size is None:
        patch_size = assumed_patch_size(header.width, header.height)
        conversions.append(f"no scale in the file: patch taken as {DEFAULT_PATCH_WIDTH} m wide")
    # Half floats stay half: the samples are no more precise than the factors.
    half = all(matrix.scalar.itemsize == 2 for matrix in header.directions)
    return Source(
        path=path,
        format=FORMAT,
        light=header.light,
        view=header.view,
        shape=(len(header.light), len(header.view), header.height, header.width, _CHANNELS),
        dtype=np.dtype("<f2" if half else "<f4"),
        patch_size=patch_size,
        conversions=conversions,
        details={
            "colour_model": f"{header.colour_model} ({_COLOUR_MODELS[header.colour_model]})",
            "cosine_flag": header.meta.cosine_flag,
            "components": [matrix.components for matrix in header.directions],
        },
        bytes=header.bytes,
        blocks=partial(_blocks, path, header, scaled),
    )


def _cosine(meta: _Meta, override: int | None, name: str) -> tuple[bool, list[str]]:
    """Whether to multiply by cos(theta_light), and what to record of it."""
    if override == 0:
        return True, ["multiplied by cos(theta_light), as asked"]
    if override == 1:
        return False, ["values taken to include cos(theta_light), as asked"]
    if meta.cosine_flag is None:
        return False, [
            f"no cosine flag in a version {meta.version} header: values taken to include "
            "cos(theta_light)"
        ]
    if meta.cosine_flag == 0:
        return True, ["multiplied by cos(theta_light), left out by the file's cosine flag 0"]
    if meta.cosine_flag == 1:
        return False, []
    raise NacreError(
        f"{name} has the unknown cosine flag {meta.cosine_flag}: say whether its values include "
        "cos(theta_light) by giving cosine 0 or 1"
    )


def _patch_size(header: _Header) -> tuple[float, float] | None:
    """Width and height in metres, or None when the file's scale is no use."""
    scale = header.meta.pixels_per_mm
    if not (math.isfinite(scale) and scale > 0):
        return None
    return header.width / scale * 1e-3, header.height / scale * 1e-3


# --- the header -----------------------------------------------------------------------------------


class _Cursor:
    """Reads little-endian fields from a file of known size and never past its end."""

    def __init__(self, file: BinaryIO, size: int, problem: str) -> None:
        self._file = file
        self._size = size
        self._problem = problem

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

    def numbers(self, layout: str, what: str) -> tuple:
        layout = "<" + layout
        return struct.unpack(layout, self.take(struct.calcsize(layout), what))

    def u32(self, what: str) -> int:
        return self.numbers("I", what)[0]


def _first_bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_LONGEST)
    except OSError:
        return b""


def _signature(start: bytes) -> bytes | None:
    known = [signature for signature in (*_DFMF, *_OTHERS) if start.startswith(signature)]
    return max(known, key=len, default=None)


def _read_header(file: BinaryIO, path: Path) -> _Header:
    name = path.name
    start = file.read(_LONGEST)
    signature = _signature(start)
    if signature is None:
        found = start.decode("ascii", "replace")
        raise NacreError(
            f"{name} is not a UBO2014 .btf file: it starts with {found!r}, not !DFMF08FCR"
        )
    if signature in _OTHERS:
        raise NacreError(
            f"{name} is a Bonn {_OTHERS[signature]} file, which is not supported yet; "
            "DFMF files (!DFMF08FCR) are"
        )
    size = path.stat().st_size
    cursor = _Cursor(file, size, f"{name} is cut short or damaged")
    file.seek(len(signature))
    meta = _read_meta(cursor, name)
    view, light = _read_directions(cursor, name)
    width, height = cursor.numbers("2I", "the image size")
    if width == 0 or height == 0:
        raise NacreError(f"{name} is damaged: its images are {width} x {height} texels")
    rotated = _DFMF[signature] and _read_rotations(cursor)
    _, colour_model = cursor.numbers("Ii", "the colour model")
    if colour_model not in _COLOUR_MODELS:
        known = ", ".join(f"{number} {label}" for number, label in _COLOUR_MODELS.items())
        label = _OTHER_MODELS.get(colour_model, "unknown")
        raise NacreError(
            f"{name} has the colour model {colour_model} ({label}), which is not supported; these "
            f"are: {known}"
        )
    cursor.skip(48, "the colour mean and matrix")  # used by the PCA colour model only
    pairs, texels = len(light) * len(view), width * height
    factors = [_read_channel(cursor, name, c, pairs, texels) for c in range(1, _CHANNELS + 1)]
    if cursor.left:
        raise NacreError(f"{name} is damaged: {cursor.left} bytes follow its end")
    factors = [factors[c] for c in meta.channel_order]
    return _Header(
        meta=meta,
        light=light,
        view=view,
        width=width,
        height=height,
        rotated=rotated,
        colour_model=colour_model,
        directions=[directions for directions, _ in factors],
        texels=[texels for _, texels in factors],
        bytes=size,
    )


def _read_meta(cursor: _Cursor, name: str) -> _Meta:
    """The first part of the header; what a writer added at its end is passed over."""
    size = cursor.u32("the header's size")
    data = cursor.take(max(size - 4, 0), "the header")
    meta = _Cursor(io.BytesIO(data), len(data), f"{name} has a damaged header")
    version = meta.u32("the version")
    if not 1 <= version <= 4:
        raise NacreError(f"{name} has the header version {version}; 1 to 4 are supported")
    meta.skip(3 * 80, "the names of setup, sensor and light")
    (pixels_per_mm,) = meta.numbers("f", "the scale")
    meta.skip(12, "the RGB scale")
    cosine_flag = meta.u32("the cosine flag") if version > 1 else None
    if version > 2:
        meta.skip(meta.u32("the XML's length"), "the XML")
    names = ["R", "G", "B"]
    if version > 3:
        count = meta.u32("the number of channels")
        if count != _CHANNELS:
            raise NacreError(f"{name} has {count} colour channels; only RGB files are supported")
        names = [_read_name(meta) for _ in range(count)]
    return _Meta(version, pixels_per_mm, cosine_flag, _rgb_order(names, name))


def _read_name(meta: _Cursor) -> str:
    name = meta.take(meta.u32("a channel name's length"), "a channel name")
    return name.rstrip(b"\0").decode("utf-8", "replace")


def _rgb_order(names: list[str], name: str) -> list[int]:
    """Where red, green and blue are among the stored channels; Y, U, V stay as they are."""
    initials = [channel[:1].upper() for channel in names]
    if initials == ["Y", "U", "V"]:
        return [0, 1, 2]
    if sorted(initials) != ["B", "G", "R"]:
        raise NacreError(
            f"{name} has the channels {', '.join(names)}; only RGB files are supported"
        )
    return [initials.index(initial) for initial in "RGB"]


def _read_rotations(cursor: _Cursor) -> bool:
    """Whether there are rotations of local frames other than the identity."""
    count = cursor.u32("the number of rotations")
    matrices = np.frombuffer(cursor.take(36 * count, f"{count} rotations"), "<f4")
    return bool((matrices.reshape(-1, 3, 3) != np.eye(3)).any())


def _read_directions(cursor: _Cursor, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors of the views and of the lights, whose list is repeated for each view."""
    count = cursor.u32("the number of views")
    cursor.need(12 * count, f"{count} views")
    views: list[tuple[float, float]] = []
    lights = b""
    for view in range(count):
        theta, phi, light_count = cursor.numbers("2fI", f"view {view}")
        listed = cursor.take(8 * light_count, f"{light_count} light directions of view {view}")
        if view == 0:
            lights = listed
        elif listed != lights:
            raise NacreError(
                f"{name} has other light directions for view {view} than for view 0; only one "
                "list for all views is supported"
            )
        views.append((theta, phi))
    if not views or not lights:
        raise NacreError(f"{name} is damaged: it has no {'lights' if views else 'views'}")
    light_angles = np.frombuffer(lights, "<f4").reshape(-1, 2)
    return _unit(np.array(views), name, "view"), _unit(light_angles, name, "light")


def _unit(radians: np.ndarray, name: str, what: str) -> np.ndarray:
    angles = np.degrees(radians.astype(np.float64))
    for index, (theta, phi) in enumerate(angles):
        if not (math.isfinite(theta) and math.isfinite(phi) and is_above_horizon(theta)):
            raise NacreError(
                f"{name} is damaged: {what} {index} has theta {theta:.6g} and phi {phi:.6g} "
                "degrees, which is no direction above the surface"
            )
    return spherical_to_unit(angles[:, 0], angles[:, 1])


def _read_channel(
    cursor: _Cursor, name: str, channel: int, pairs: int, texels: int
) -> tuple[_Matrix, _Matrix]:
    """The factors of one channel, (directions, texels); the file holds S, U and SxV."""
    label = f"channel {channel}"
    scalar_size, components, rows, columns = cursor.numbers("B3I", f"{label}'s sizes")
    if scalar_size not in _SCALARS:
        raise NacreError(
            f"{name} is damaged: {label} has scalars of {scalar_size} bytes, not 2, 4 or 8"
        )
    if components == 0:
        raise NacreError(f"{name} is damaged: {label} has no components")
    transposed = (rows, columns) == (texels, pairs) and texels != pairs
    if not transposed and (rows, columns) != (pairs, texels):
        raise NacreError(
            f"{name} is damaged: {label} is a matrix of {rows} x {columns}, but its directions and "
            f"images need {pairs} x {texels}"
        )
    scalar = _SCALARS[scalar_size]
    row_size = components * scalar_size
    cursor.skip(row_size, f"{label}'s singular values")
    u_start = cursor.skip(row_size * rows, f"{label}'s U")
    v_start = cursor.skip(row_size * columns, f"{label}'s SxV")
    u = _Matrix(f"U of {label}", u_start, rows, components, scalar)
    v = _Matrix(f"SxV of {label}", v_start, columns, components, scalar)
    return (v, u) if transposed else (u, v)


# --- the samples ----------------------------------------------------------------------------------


def _blocks(path: Path, header: _Header, scaled: bool) -> Generator[np.ndarray]:
    """Samples (views, y, x, channel) float32: for each light, a few views at a time."""
    directions = [
        matrix.reshape(len(header.view), len(header.light), -1)
        for matrix in _load(path, header.directions)
    ]
    texels = _load(path, header.texels)
    sample_bytes = header.width * header.height * _CHANNELS * 4
    step = max(1, BLOCK_BYTES // sample_bytes)
    for light, cosine in enumerate(header.light[:, 2].astype(np.float32)):
        for first in range(0, len(header.view), step):
            # One pass of overflow is let through to the writer, which knows the sample's place.
            with np.errstate(over="ignore", invalid="ignore"):
                planes = [
                    u[first : first + step, light] @ v.T
                    for u, v in zip(directions, texels, strict=True)
                ]
                block = np.stack(_to_rgb(planes, header.colour_model), axis=-1)
                if scaled:
                    block *= cosine
            yield block.reshape(-1, header.height, header.width, _CHANNELS)


def _load(path: Path, matrices: list[_Matrix]) -> list[np.ndarray]:
    """The factors as float32 (rows, components)."""
    loaded = []
    for matrix in matrices:
        count = matrix.rows * matrix.components
        try:
            raw = np.fromfile(path, matrix.scalar, count, offset=matrix.offset)
        except OSError as error:
            raise NacreError(f"cannot read {path}: {error.strerror}") from error
        if raw.size != count:
            raise NacreError(f"{path.name} was cut short while it was read")
        with np.errstate(over="ignore", under="ignore"):
            values = raw.astype(np.float32).reshape(matrix.rows, matrix.components)
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            row = int(np.argmin(finite))
            raise NacreError(
                f"{path.name} is damaged: {matrix.name} has a value that is not a finite number "
                f"in row {row}"
            )
        loaded.append(values)
    return loaded


def _to_rgb(planes: list[np.ndarray], colour_model: int) -> list[np.ndarray]:
    """Decoded channels to linear RGB, following btflib's `undecorrelate`; may reuse the arrays."""
    if colour_model == 0:
        return planes
    if colour_model == 12:
        return [np.exp(plane, out=plane) - _LOG_OFFSET for plane in planes]
    y, u, v = planes
    np.exp(y, out=y)
    if colour_model == 11:
        # The chroma was divided by Y + offset, which is what the exponential gives.
        u *= y
        v *= y
    y -= _LOG_OFFSET
    return [
        y + np.float32(1.13983) * v,
        y - np.float32(0.39465) * u - np.float32(0.5806) * v,
        y + np.float32(2.03211) * u,
    ]
