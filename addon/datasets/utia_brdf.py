"""UTIA's BRDFs, `.bin`: anisotropic, as measured at 288 light and 288 view directions.

Filip and Vavra, "Template-Based Sampling of Anisotropic BRDFs", 2014. Doubles (channel,
theta_light, phi_light, theta_view, phi_view), theta each 15 degrees from 0 to 75, phi each 7.5
degrees, without a header. Values are sRGB-encoded and may be negative.

Decoded values are interpolated linearly between the four neighbours of each direction. (UTIA's own
code interpolates encoded ones, and extrapolates to the horizon: here lower directions take the
values of 75 degrees.)
"""

import math
from pathlib import Path

import numpy as np

from ..errors import NacreError
from .brdf import uniform as uniform_brdf
from .brdf.uniform import Evaluate, uniform_source
from .colour import srgb_to_linear
from .options import Options
from .source import Source

FORMAT = "utia-brdf"
EXTENSIONS = (".bin",)
OPTIONS = uniform_brdf.OPTIONS | {"gamma", "white"}

_SHAPE = (3, 6, 48, 6, 48)
_THETA_STEP = 15.0
_PHI_STEP = 7.5
# Nothing says what the files hold but their size: what is beyond this is no reflectance.
_LARGEST = 1e6


def matches(path: Path) -> bool:
    """Whether the name, the size and the range of values are those of such a file."""
    try:
        if path.suffix.lower() not in EXTENSIONS or path.stat().st_size != _size():
            return False
        return _is_plausible(np.fromfile(path, "<f8"))
    except OSError:
        return False


def open_source(path: Path, options: Options) -> Source:
    """Read the table, and count what is negative in it.

    `gamma` is "srgb" when not given, `white` the f_r of a white diffuser, 1/pi. Raises NacreError
    for a file of another size and for one that holds no reflectances.
    """
    try:
        size = path.stat().st_size
        if size != _size():
            raise NacreError(
                f"{path.name} has {size} bytes; a UTIA BRDF is of {_size()}: 3 x 288 x 288 doubles"
            )
        stored = np.fromfile(path, "<f8")
    except OSError as error:
        raise NacreError(f"cannot read {path}: {error.strerror}") from error
    if not _is_plausible(stored):
        raise NacreError(
            f"{path.name} is not a UTIA BRDF: it holds values that are no reflectances, beyond "
            f"{_LARGEST:g} or not finite"
        )
    gamma = "srgb" if options.gamma is None else options.gamma
    white = 1.0 / math.pi if options.white is None else options.white
    encoding = "sRGB" if gamma == "srgb" else f"gamma {gamma:g}"
    conversions = [
        f"values decoded from {encoding}{_asked(options.gamma)}",
        f"{white:g} taken as a white diffuser{_asked(options.white)}, otherwise values as f_r; "
        "multiplied by cos(theta_light)",
        "directions below 75 degrees take the values of 75 degrees",
    ]
    negative = int(np.count_nonzero(stored < 0.0))
    if negative:
        conversions.append(f"{negative} of {stored.size} values are negative: taken as 0")
    return uniform_source(
        path,
        FORMAT,
        options,
        size,
        conversions,
        {"measured": [288, 288]},
        5 * size,  # as stored and decoded, and three times on the way
        lambda: _evaluator(_decoded(stored, gamma) / white),
    )


def _size() -> int:
    return 8 * math.prod(_SHAPE)


def _asked(option: object) -> str:
    return "" if option is None else ", as asked"


def _is_plausible(values: np.ndarray) -> bool:
    with np.errstate(invalid="ignore"):
        return bool(np.all(np.abs(values) <= _LARGEST))  # false for NaN


def _decoded(values: np.ndarray, gamma: float | str) -> np.ndarray:
    """Linear values; those below 0 are 0."""
    if gamma == "srgb":
        return srgb_to_linear(values)
    return np.maximum(values, 0.0) ** float(gamma)


def _evaluator(table: np.ndarray) -> Evaluate:
    """`table` has 3 * 288 * 288 values of f_r over white's."""
    _, thetas, phis, _, _ = _SHAPE
    table = table.reshape(3, thetas * phis, thetas * phis)

    def evaluate(light: np.ndarray, view: np.ndarray) -> np.ndarray:
        rows, row_weights = _neighbours(light)
        columns, column_weights = _neighbours(view)
        values = np.zeros((len(light), 3))
        for row, row_weight in zip(rows, row_weights, strict=True):
            for column, column_weight in zip(columns, column_weights, strict=True):
                values += (row_weight * column_weight * table[:, row, column]).T
        return values * light[:, 2:]

    return evaluate


def _neighbours(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The four directions of the table around each (4, n), and their weights (4, n)."""
    _, thetas, phis, _, _ = _SHAPE
    theta = np.degrees(uniform_brdf.elevation(directions)) / _THETA_STEP
    phi = np.degrees(np.arctan2(directions[:, 1], directions[:, 0])) / _PHI_STEP % phis
    ring = np.minimum(theta.astype(np.intp), thetas - 2)
    step = np.minimum(phi.astype(np.intp), phis - 1)
    a, b = np.minimum(theta - ring, 1.0), phi - step
    numbers, weights = [], []
    for i, wa in ((0, 1.0 - a), (1, a)):
        for j, wb in ((0, 1.0 - b), (1, b)):
            numbers.append((ring + i) * phis + (step + j) % phis)
            weights.append(wa * wb)
    return np.stack(numbers), np.stack(weights)
