"""What verbs are given: the types of their arguments, and their progress callback."""

import argparse
from collections.abc import Callable
from math import inf

from ..errors import NacreError

Progress = Callable[[float, str], bool]


def counts(text: str) -> dict[str, int]:
    """A whole number for each of some modes."""
    try:
        pairs = [entry.split("=") for entry in text.split(",")]
        return {mode.strip(): int(value) for mode, value in pairs}
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form view=4,y=32") from None


def sparsity_parts(given: dict[str, int], keys: tuple[str, ...]) -> dict[str, int]:
    """Coefficients of each part of an ensemble out of y=256,uv=32: u and v may go together.

    Raises NacreError for a part that is missing or not there.
    """
    rest = {name.upper(): count for name, count in given.items()}
    if "UV" in rest and "UV" not in keys:
        count = rest.pop("UV")
        rest = {"U": count, "V": count} | rest
    if set(rest) != set(keys):
        expected = ",".join(f"{key.lower()}=.." for key in keys)
        raise NacreError(f"sparsity: expected {expected}, with uv=.. for u and v alike")
    return {key: rest[key] for key in keys}


def index_range(text: str) -> slice:
    """A Python slice I:J; either end may be missing."""
    try:
        first, last = (int(part) if part else None for part in text.split(":"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form 3:7") from None
    return slice(first, last)


def angles(text: str) -> tuple[float, float]:
    """A direction (theta, phi) in degrees above the surface."""
    try:
        theta, phi = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form 45,90 (degrees)") from None
    if not 0.0 <= theta <= 90.0:
        raise argparse.ArgumentTypeError(f"theta {theta:g} is not between 0 and 90 degrees")
    if not abs(phi) <= 360.0:
        raise argparse.ArgumentTypeError(f"phi {phi:g} is not between -360 and 360 degrees")
    return theta, phi


def picture_size(text: str) -> tuple[int, int]:
    """(width, height) in pixels, as far as Blender goes."""
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form 640x480") from None
    if not (0 < width <= 16384 and 0 < height <= 16384):
        raise argparse.ArgumentTypeError(f"{text!r}: each side is between 1 and 16384 pixels")
    return width, height


def gigabytes(text: str) -> int:
    """Bytes, given as a number of gigabytes (10^9)."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.2 <= value < 1e6:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of gigabytes from 0.2 on")
    return round(value * 1e9)


def from_0(text: str) -> int:
    """A whole number of 0 or more."""
    return _at_least(0, text)


def from_1(text: str) -> int:
    """A whole number of 1 or more."""
    return _at_least(1, text)


def _at_least(least: int, text: str) -> int:
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if value < least:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of {least} or more")
    return value


def above_0(text: str) -> float:
    """A finite number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value


def share(text: str) -> float:
    """A number from 0 to 1."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 0 to 1")
    return value


def lengths(text: str) -> tuple[float, float]:
    """Width and height in metres; one number for both."""
    try:
        sides = [above_0(side) for side in text.split(",")]
    except argparse.ArgumentTypeError:
        sides = []
    if len(sides) not in (1, 2):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form 0.02 or 0.02,0.03 (metres)")
    return sides[0], sides[-1]


def part_of(text: str) -> tuple[int, int]:
    """The i-th of n parts, counted from 1."""
    try:
        number, count = (int(field) for field in text.split("/"))
    except ValueError:
        number = count = 0
    if not 1 <= number <= count:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form 2/5")
    return number, count


def gamma(text: str) -> float | str:
    """An exponent above 0, or "srgb"."""
    if text == "srgb":
        return text
    try:
        return above_0(text)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0 or srgb") from None
