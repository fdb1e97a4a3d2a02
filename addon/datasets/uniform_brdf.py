"""A uniform BRDF as a BTF of one texel, sampled at any directions.

What the readers of BRDFs share: which directions, and the samples light by light.
"""

from collections.abc import Callable, Generator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import NacreError
from .direction_sets import direction_set
from .options import Options
from .source import CHANNELS, DEFAULT_PATCH_WIDTH, Source

OPTIONS = frozenset({"lights", "views", "directions", "patch_width"})
"""What every reader of BRDFs takes."""

USUAL_DIRECTIONS = "ubo81"

Evaluate = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Light (3,) and views (V, 3) -> pi f_r cos(theta_light) (V, channels).

All are unit vectors above the surface.
"""

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
    load: Callable[[], Evaluate],
) -> Source:
    """The source of a BRDF at the directions that the options ask for.

    `load` reads the tables, once the samples are wanted. `conversions` is of the values; directions
    and the patch are added. Raises NacreError for directions that are given twice or not known.
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
    )


def half_difference(light: np.ndarray, view: np.ndarray) -> tuple[np.ndarray, ...]:
    """(theta_h, theta_d, phi_d) in radians, each (V,), of a light (3,) and views (V, 3).

    Rusinkiewicz' coordinates: the half vector's angle from the normal, and the light in the frame
    of the half vector, whose first axis lies in the plane of normal and half vector. Where the two
    coincide, and where light and half vector do, the azimuth is that of vectors in one plane.
    """
    half = light + view
    half /= np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-12)
    theta_half = elevation(half)
    theta_difference = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(light - half, axis=-1), 0, 1))
    across = np.hypot(half[:, 0], half[:, 1])
    apart = across > 1e-9
    along = np.stack([half[:, 0], half[:, 1]], -1) / np.where(apart, across, 1.0)[:, None]
    # The light turned about the normal until the half vector is above +x; then the frame's axes are
    # (cos theta_h, 0, -sin theta_h) and y.
    x = light[0] * along[:, 0] + light[1] * along[:, 1]
    y = light[1] * along[:, 0] - light[0] * along[:, 1]
    x = x * half[:, 2] - light[2] * across
    planar = ~apart | (np.hypot(x, y) <= 1e-9)
    phi_difference = np.where(planar, 0.0, np.arctan2(y, x))
    return theta_half, theta_difference, phi_difference


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
    """Samples (views, 1, 1, channel) float32, one light after the other."""
    try:
        evaluate = load()
    except OSError as error:
        raise NacreError(f"cannot read {path}: {error.strerror}") from error
    views = _above(view)
    for direction, raised in zip(light, _above(light), strict=True):
        values = np.zeros((len(views), len(CHANNELS)), np.float32)
        if direction[2] > _LEAST_COSINE:
            # What overflows is found when the samples are written.
            with np.errstate(over="ignore", invalid="ignore"):
                values[...] = evaluate(raised, views)
        yield values[:, None, None]


def _above(directions: np.ndarray) -> np.ndarray:
    """The same unit vectors, none at or below the horizon."""
    raised = np.array(directions)
    raised[:, 2] = np.maximum(raised[:, 2], _LEAST_COSINE)
    return raised / np.linalg.norm(raised, axis=-1, keepdims=True)
