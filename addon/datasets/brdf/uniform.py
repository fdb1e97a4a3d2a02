"""A uniform BRDF as a BTF of one texel, sampled at any directions.

What the readers of BRDFs share: which directions, and the samples a few lights at a time.
"""

from collections.abc import Callable, Generator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import NacreError
from ..direction_sets import direction_set
from ..options import Options
from ..source import CHANNELS, DEFAULT_PATCH_WIDTH, Source

OPTIONS = frozenset({"lights", "views", "directions", "patch_width"})
"""What every reader of BRDFs takes."""

USUAL_DIRECTIONS = "ubo81"

Evaluate = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Lights (n, 3) and views (n, 3) -> pi f_r cos(theta_light) (n, 3).

All are unit vectors above the surface.
"""

# As many pairs of light and view are evaluated at a time, or those of one light.
_PAIRS = 2**13
_PAIR_BYTES = 1000

# What overflows or is no number is found when the samples are written.
_SILENT: dict[str, Any] = {"over": "ignore", "invalid": "ignore"}

# Views at the horizon are evaluated this much (the sine of the angle) above it, where tables end;
# lights as low are dark.
_LEAST_COSINE = 1e-6


def uniform_source(
    path: Path,
    format: str,
    options: Options,
    size: int,
    conversions: list[str],
    details: dict[str, Any],
    memory: int,
    load: Callable[[], Evaluate],
) -> Source:
    """The source of a BRDF at the directions that the options ask for.

    `load` reads the tables, once the samples are wanted, into `memory` bytes. `conversions` is of
    the values; directions and the patch are added. Raises NacreError for directions that are given
    twice or not known.
    """
    light, view, sampled = _directions(options)
    width = DEFAULT_PATCH_WIDTH if options.patch_width is None else options.patch_width
    given = "" if options.patch_width is None else ", as asked"
    return Source(
        path=path,
        format=format,
        light=light,
        view=view,
        shape=(len(light), len(view), 1, 1, len(CHANNELS)),
        dtype=np.dtype("<f4"),
        patch_size=(width, width),
        conversions=[
            *conversions,
            *sampled,
            f"a uniform BRDF has no scale: patch taken as {width:g} m wide{given}",
        ],
        details=details,
        bytes=size,
        blocks=partial(_blocks, path, light, view, load),
        memory=memory + _PAIR_BYTES * max(len(view), min(_PAIRS, len(light) * len(view))),
    )


def half_difference(light: np.ndarray, view: np.ndarray) -> tuple[np.ndarray, ...]:
    """(theta_h, theta_d, phi_d) in radians, each (n,), of lights (n, 3) and views (n, 3).

    Rusinkiewicz' coordinates: the half vector's angle from the normal, and the light in the frame
    of the half vector, whose first axis lies in the plane of normal and half vector. Where the two
    coincide, and where light and half vector do, the azimuth is that of vectors in one plane.
    """
    half = half_vector(light, view)
    theta_half = elevation(half)
    theta_difference = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(light - half, axis=-1), 0, 1))
    across = np.hypot(half[:, 0], half[:, 1])
    apart = across > 1e-9
    along = np.stack([half[:, 0], half[:, 1]], -1) / np.where(apart, across, 1.0)[:, None]
    # The light turned about the normal until the half vector is above +x; then the frame's axes are
    # (cos theta_h, 0, -sin theta_h) and y.
    x = light[:, 0] * along[:, 0] + light[:, 1] * along[:, 1]
    y = light[:, 1] * along[:, 0] - light[:, 0] * along[:, 1]
    x = x * half[:, 2] - light[:, 2] * across
    planar = ~apart | (np.hypot(x, y) <= 1e-9)
    phi_difference = np.where(planar, 0.0, np.arctan2(y, x))
    return theta_half, theta_difference, phi_difference


def half_vector(light: np.ndarray, view: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 3) midway between lights and views (n, 3)."""
    between = light + view
    length = np.linalg.norm(between, axis=-1, keepdims=True)
    half: np.ndarray = between / np.maximum(length, 1e-12)
    return half


def elevation(directions: np.ndarray) -> np.ndarray:
    """Angles (n,) in radians between unit vectors (n, 3) and the normal, exact for small ones."""
    apart = np.linalg.norm(directions - [0.0, 0.0, 1.0], axis=-1)
    return 2.0 * np.arcsin(np.clip(0.5 * apart, 0.0, 1.0))


def _directions(options: Options) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Lights, views and what to record of them."""
    if options.directions is not None:
        if options.lights is not None or options.views is not None:
            raise NacreError("give --directions, or --lights and --views, but not both")
        both = direction_set(str(options.directions))
        name = Path(options.directions).name
        return both, both, [f"sampled at the {len(both)} directions of {name}, lights and views"]
    lights, views = (name or USUAL_DIRECTIONS for name in (options.lights, options.views))
    light = direction_set(lights)
    view = light if views == lights else direction_set(views)
    return (
        light,
        view,
        [
            f"sampled at {len(light)} lights ({Path(lights).name}) and {len(view)} views "
            f"({Path(views).name})"
        ],
    )


def _blocks(
    path: Path, light: np.ndarray, view: np.ndarray, load: Callable[[], Evaluate]
) -> Generator[np.ndarray]:
    """Samples (lights, views, 1, 1, channel) float32, a few lights at a time."""
    try:
        with np.errstate(**_SILENT):
            evaluate = load()
    except OSError as error:
        raise NacreError(f"cannot read {path}: {error.strerror}") from error
    step = max(1, _PAIRS // len(view))
    for first in range(0, len(light), step):
        chunk = light[first : first + step]
        pairs = np.repeat(_above(chunk), len(view), 0), np.tile(_above(view), (len(chunk), 1))
        with np.errstate(**_SILENT):
            values = evaluate(*pairs).astype(np.float32)
        values = values.reshape(len(chunk), len(view), 1, 1, len(CHANNELS))
        values[chunk[:, 2] <= _LEAST_COSINE] = 0.0
        yield values


def _above(directions: np.ndarray) -> np.ndarray:
    """The same unit vectors, none at or below the horizon."""
    raised = np.array(directions)
    raised[:, 2] = np.maximum(raised[:, 2], _LEAST_COSINE)
    return raised / np.linalg.norm(raised, axis=-1, keepdims=True)
