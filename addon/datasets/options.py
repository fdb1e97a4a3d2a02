"""What a user may say of a measured file that the file itself does not."""

import math
from dataclasses import dataclass, fields
from pathlib import Path

from ..errors import NacreError


@dataclass(frozen=True)
class Options:
    """None leaves it to the file, or to what its format usually means.

    Raises NacreError for a value that is none of these:

    cosine: 1 when values include cos(theta_light), 0 when they are to be multiplied by it.
    gamma: the exponent that gives linear values (1 for linear files), or "srgb".
    white: the linear value, in the file's units, of a white diffuser lit head-on.
    colour_space: "rec709" or "xyz" (CIE 1931, D65).
    patch_width: the patch's width in metres.
    directions: a CSV file; of masks the view of each, of images the light and view of each.
    lights, views: the directions (see direction_sets) that a BRDF is sampled at.
    """

    cosine: int | None = None
    gamma: float | str | None = None
    white: float | None = None
    colour_space: str | None = None
    patch_width: float | None = None
    directions: str | Path | None = None
    lights: str | None = None
    views: str | None = None

    def __post_init__(self) -> None:
        if self.cosine not in (None, 0, 1):
            raise NacreError(f"cosine must be 0 or 1, not {self.cosine}")
        if self.colour_space not in (None, "rec709", "xyz"):
            raise NacreError(f"colour_space must be rec709 or xyz, not {self.colour_space}")
        for name in ("gamma", "white", "patch_width"):
            value = getattr(self, name)
            if value is None or (name == "gamma" and value == "srgb"):
                continue
            if not (isinstance(value, int | float) and math.isfinite(value) and value > 0):
                raise NacreError(f"{name} must be a number above 0, not {value}")

    def given(self) -> list[str]:
        """The names of those that are not None."""
        return [field.name for field in fields(self) if getattr(self, field.name) is not None]
