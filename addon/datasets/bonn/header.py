"""What all layouts begin with: signature, header, directions, image size, rotations."""

import io
from dataclasses import dataclass

import numpy as np

from ...errors import NacreError
from ..directions import is_above_horizon, spherical_to_unit
from .cursor import Cursor

LONGEST_SIGNATURE = 10

# Far beyond any spectral measurement; samples of a texel are held for all channels at once.
MOST_CHANNELS = 1024


@dataclass(frozen=True)
class Meta:
    """The header proper; `version` is 0 and all else missing in PVF's oldest kind of file.

    pixels_per_mm may be anything, cosine_flag is None where the version has none.
    """

    version: int
    pixels_per_mm: float
    rgb_scale: tuple[float, ...]
    cosine_flag: int | None
    channels: list[str]


@dataclass(frozen=True)
class Header:
    """What all layouts share. light (L, 3) and view (V, 3) are unit vectors.

    `rotated` says whether there are rotations of local frames other than the identity.
    """

    meta: Meta
    light: np.ndarray
    view: np.ndarray
    width: int
    height: int
    rotated: bool

    @property
    def channels(self) -> int:
        return len(self.meta.channels)

    @property
    def texels(self) -> int:
        return self.width * self.height

    @property
    def pairs(self) -> int:
        return len(self.light) * len(self.view)


def read_header(cursor: Cursor, with_rotations: bool) -> Header:
    meta = read_meta(cursor)
    view, light = read_directions(cursor)
    width, height = read_size(cursor)
    rotated = with_rotations and read_rotations(cursor)
    return Header(meta, light, view, width, height, rotated)


def read_meta(cursor: Cursor) -> Meta:
    """The first part; what a writer added at its end is passed over."""
    size = cursor.u32("the header's size")
    data = cursor.take(max(size - 4, 0), "the header")
    meta = Cursor(io.BytesIO(data), len(data), cursor.name, f"{cursor.name} has a damaged header")
    version = meta.u32("the version")
    if not 1 <= version <= 4:
        raise NacreError(f"{cursor.name} has the header version {version}; 1 to 4 are supported")
    meta.skip(3 * 80, "the names of setup, sensor and light")
    pixels_per_mm, *rgb_scale = meta.numbers("4f", "the scale")
    cosine_flag = meta.u32("the cosine flag") if version > 1 else None
    if version > 2:
        meta.skip(meta.u32("the XML's length"), "the XML")
    channels = ["R", "G", "B"]
    if version > 3:
        count = meta.u32("the number of channels")
        if not 0 < count <= MOST_CHANNELS:
            raise NacreError(
                f"{cursor.name} has {count} colour channels; 1 to {MOST_CHANNELS} are supported"
            )
        channels = [_read_name(meta) for _ in range(count)]
    return Meta(version, pixels_per_mm, tuple(rgb_scale), cosine_flag, channels)


def _read_name(meta: Cursor) -> str:
    name = meta.take(meta.u32("a channel name's length"), "a channel name")
    return name.rstrip(b"\0").decode("utf-8", "replace").strip()


def read_directions(cursor: Cursor) -> tuple[np.ndarray, np.ndarray]:
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
                f"{cursor.name} has other light directions for view {view} than for view 0; only "
                "one list for all views is supported"
            )
        views.append((theta, phi))
    if not views or not lights:
        raise cursor.damaged(f"it has no {'lights' if views else 'views'}")
    light_angles = np.frombuffer(lights, "<f4").reshape(-1, 2)
    return _unit(np.array(views), cursor, "view"), _unit(light_angles, cursor, "light")


def _unit(radians: np.ndarray, cursor: Cursor, what: str) -> np.ndarray:
    with np.errstate(invalid="ignore"):  # a signalling NaN
        theta, phi = np.degrees(radians.astype(np.float64)).T
    good = is_above_horizon(theta) & np.isfinite(phi)  # a theta of NaN is not above it
    if not good.all():
        index = int(np.argmin(good))
        raise cursor.damaged(
            f"{what} {index} has theta {theta[index]:.6g} and phi {phi[index]:.6g} degrees, which "
            "is no direction above the surface"
        )
    return spherical_to_unit(theta, phi)


def read_size(cursor: Cursor) -> tuple[int, int]:
    width, height = cursor.numbers("2I", "the image size")
    if width == 0 or height == 0:
        raise cursor.damaged(f"its images are {width} x {height} texels")
    return width, height


def read_rotations(cursor: Cursor) -> bool:
    """Whether there are rotations of local frames other than the identity."""
    count = cursor.u32("the number of rotations")
    matrices = np.frombuffer(cursor.take(36 * count, f"{count} rotations"), "<f4")
    return bool((matrices.reshape(-1, 3, 3) != np.eye(3)).any())
