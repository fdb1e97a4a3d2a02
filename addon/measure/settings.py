"""How a patch is measured: everything a user chooses beyond the patch and its directions."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from ..errors import NacreError


@dataclass(frozen=True)
class Settings:
    """Defaults suit most materials.

    width: texels along the patch's width; as many to the metre along its height.
    samples: paths through each texel of each picture, or
    noise_db: the noise floor to reach instead, in decibels, with samples found by trial.
    bounces: how often light goes on from where it first arrives.
    seed: of the first picture; each has the next.
    Raises NacreError for what cannot be measured.
    """

    width: int = 64
    samples: int = 16
    noise_db: float | None = None
    bounces: int = 4
    seed: int = 0

    def __post_init__(self) -> None:
        for name, least, most in (
            ("width", 1, 4096),
            ("samples", 1, 2**16),
            ("bounces", 0, 1024),
            ("seed", 0, 2**30),
        ):
            value = getattr(self, name)
            if not least <= value <= most:
                raise NacreError(f"{name} {value}: expected a number from {least} to {most}")
        if self.noise_db is not None and not 0 < self.noise_db <= 60:
            raise NacreError(f"noise target {self.noise_db:g} dB: expected up to 60 dB")

    def texels(self, size: tuple[float, float]) -> tuple[int, int]:
        """Texels (x, y) of a patch of `size` (width, height) in metres."""
        return self.width, max(1, round(self.width * size[1] / size[0]))

    def described(self) -> dict[str, Any]:
        """JSON-able; what a noise target makes of the samples is not known yet."""
        given = asdict(self)
        del given["samples" if self.noise_db is not None else "noise_db"]
        return given
