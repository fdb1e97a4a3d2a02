"""Datasets as UBO2003 zips, which other programs for measured materials read.

One JPEG for each pair of light and view, named by its angles in whole degrees:
`tvTTT_pvPPP/NNNNN tlTTT plPPP tvTTT pvPPP.jpg`, gamma 2.2, the light's cosine included.
"""

import io
import os
import secrets
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import Cancelled, NacreError
from .dataset import Dataset
from .directions import spherical_to_unit, unit_to_spherical

GAMMA = 2.2
QUALITY = 95
"""JPEG's quality; colours are not subsampled."""

# Zip entries have a time, and the same dataset gives the same bytes.
_TIME = (1980, 1, 1, 0, 0, 0)

Progress = Callable[[float, str], bool]


def write_ubo2003(
    dataset: Dataset,
    path: str | Path,
    *,
    white: float = 1.0,
    quality: int = QUALITY,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Write a BTF to the zip `path`; returns what came of it, JSON-able.

    Values are divided by `white` and clipped to [0, 1]; a file has no place to say so, and reads as
    if its white were 1. Returned are `images`, `bytes`, `clipped`, the share of values that were,
    and `rounded_degrees`, how far the farthest direction is from the one in its name.

    Raises NacreError for another kind of dataset, for directions that are one when rounded to whole
    degrees, and when the file cannot be written; Cancelled when `progress` answers False. Then
    nothing is left of it, and an older file there is untouched.
    """
    path = Path(path)
    if dataset.kind != "btf":
        raise NacreError(f"{dataset.path.name} is {dataset.kind}: UBO2003 files hold BTFs")
    if not (np.isfinite(white) and white > 0):
        raise NacreError(f"white must be a number above 0, not {white}")
    if path.is_dir():
        raise NacreError(f"cannot write {path}: it is a folder")
    lights, light_error = _whole_degrees(dataset.light, "light", dataset.path.name)
    views, view_error = _whole_degrees(dataset.view, "view", dataset.path.name)
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")
    try:
        with partial.open("xb") as file:
            clipped = _write(file, dataset, lights, views, white, quality, progress)
        size = partial.stat().st_size
        os.replace(partial, path)
    except OSError as error:
        raise NacreError(f"cannot write {path}: {error.strerror}") from error
    finally:
        partial.unlink(missing_ok=True)
    return {
        "images": len(lights) * len(views),
        "bytes": size,
        "clipped": clipped / dataset.samples.size,
        "rounded_degrees": round(max(light_error, view_error), 3),
    }


def _write(
    file: io.BufferedIOBase,
    dataset: Dataset,
    lights: list[tuple[int, int]],
    views: list[tuple[int, int]],
    white: float,
    quality: int,
    progress: Progress | None,
) -> int:
    """Write all images; returns how many values were clipped."""
    clipped = 0
    message = f"Writing {dataset.path.name}"
    # The images are compressed already.
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for light, (tl, pl) in enumerate(lights):
            for view, (tv, pv) in enumerate(views):
                if progress is not None and not progress(
                    (light * len(views) + view) / (len(lights) * len(views)), message
                ):
                    raise Cancelled
                values = np.asarray(dataset.samples[light, view], np.float32) / white
                clipped += int(np.count_nonzero((values > 1) | (values < 0)))
                number = view * len(lights) + light
                name = f"{number:05} tl{tl:03} pl{pl:03} tv{tv:03} pv{pv:03}.jpg"
                entry = zipfile.ZipInfo(f"tv{tv:03}_pv{pv:03}/{name}", _TIME)
                archive.writestr(entry, _jpeg(values, quality))
    if progress is not None and not progress(1.0, message):
        raise Cancelled
    return clipped


def _jpeg(values: np.ndarray, quality: int) -> bytes:
    """A JPEG file of linear values (y, x, channel), y upward."""
    try:
        import PIL.Image
    except ImportError as error:
        raise NacreError("writing images needs the Python package Pillow: install it") from error
    encoded = np.clip(values[::-1], 0, 1) ** (1 / GAMMA) * 255
    buffer = io.BytesIO()
    image = PIL.Image.fromarray(np.rint(encoded).astype(np.uint8))
    image.save(buffer, "JPEG", quality=quality, subsampling=0)
    return buffer.getvalue()


def _whole_degrees(
    directions: np.ndarray, axis: str, name: str
) -> tuple[list[tuple[int, int]], float]:
    """(theta, phi) of directions (n, 3) in whole degrees, and how far the farthest was moved."""
    theta, phi = unit_to_spherical(directions)
    rounded = np.stack([np.rint(theta), np.rint(phi) % 360], axis=1).astype(int)
    rounded[rounded[:, 0] == 0, 1] = 0  # the normal has no azimuth
    seen: dict[tuple[int, int], int] = {}
    for index, (whole_theta, whole_phi) in enumerate(rounded.tolist()):
        first = seen.setdefault((whole_theta, whole_phi), index)
        if first != index:
            raise NacreError(
                f"{name}: {axis}s {first} and {index} are both theta {whole_theta} phi {whole_phi} "
                "in whole degrees, which is all that UBO2003's names hold"
            )
    return list(seen), _largest_angle(directions, rounded)


def _largest_angle(directions: np.ndarray, degrees: np.ndarray) -> float:
    """The largest angle in degrees between directions (n, 3) and (theta, phi) in degrees (n, 2)."""
    cosines = (directions * spherical_to_unit(degrees[:, 0], degrees[:, 1])).sum(axis=1)
    return float(np.degrees(np.arccos(np.clip(cosines, -1, 1))).max())
