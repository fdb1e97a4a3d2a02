"""What the numbers in images mean: from pixels as stored to linear Rec.709 with Nacre's white.

The steps, each chosen by the user or else by the format, and each recorded: gamma, colour space,
white, cosine of the light's angle.
"""

from dataclasses import dataclass

import numpy as np

from ...errors import NacreError
from ..colour import spectrum_to_rec709, srgb_to_linear, xyz_to_rec709
from ..options import Options
from .decoding import Image

OPTIONS = frozenset({"cosine", "gamma", "white", "colour_space"})
"""The names of the Options that are heeded here."""


@dataclass(frozen=True)
class Encoding:
    """What a format means by its images where the user says nothing.

    gamma: of whole numbers, which are Rec.709, an exponent or "srgb". float_space: the colour space
    of floats in channels R, G and B, which are linear; channels X, Y and Z, and wavelengths, need
    no telling.
    """

    gamma: float | str
    float_space: str = "rec709"


@dataclass(frozen=True, eq=False)
class Decoding:
    """The steps for all images of a set, which are of one kind.

    `curve`, a gamma or "srgb", makes floats linear, `table` does so for each whole number; `matrix`
    (3, bands) makes colours Rec.709 where it is not None; `has_cosine` is False where values lack
    the cosine of the light's angle.
    """

    curve: float | str
    table: np.ndarray | None
    matrix: np.ndarray | None
    white: float
    has_cosine: bool
    conversions: list[str]

    def values(self, pixels: np.ndarray, cosine: float) -> np.ndarray:
        """Values (..., 3) float32 of pixels (..., band), all lit by a light of this cosine."""
        factor = (1.0 if self.has_cosine else cosine) / self.white
        # What becomes infinite is found, with its place, when it is written.
        with np.errstate(over="ignore", invalid="ignore"):
            if self.table is not None:
                linear = self.table[pixels]
            else:
                linear = _linear(pixels.astype(np.float32), self.curve)
            if self.matrix is not None:
                linear = linear @ self.matrix.T
            linear *= np.float32(factor)
        return linear


def choose_decoding(first: Image, encoding: Encoding, options: Options) -> Decoding:
    """The steps for images like `first`; NacreError for an option that makes no sense of them."""
    conversions = list(first.notes)
    curve = _choose_curve(first.pixels.dtype, encoding, options, conversions)
    table = None
    if first.pixels.dtype.kind == "u":
        most = np.iinfo(first.pixels.dtype).max
        table = _linear(np.arange(most + 1) / most, curve).astype(np.float32)
    matrix = _choose_matrix(first, encoding, options, conversions)
    if options.white is None:
        conversions.append("a white diffuser lit head-on taken as 1")
    else:
        conversions.append(f"divided by {options.white:g}, a white diffuser lit head-on, as asked")
    if options.cosine == 0:
        conversions.append("multiplied by cos(theta_light), as asked")
    else:
        asked = ", as asked" if options.cosine == 1 else ""
        conversions.append(f"values taken to include cos(theta_light){asked}")
    white = 1.0 if options.white is None else options.white
    return Decoding(curve, table, matrix, white, options.cosine != 0, conversions)


def _choose_curve(
    dtype: np.dtype, encoding: Encoding, options: Options, conversions: list[str]
) -> float | str:
    whole = dtype.kind == "u"
    curve: float | str = encoding.gamma if whole else 1.0
    asked = ""
    if options.gamma is not None:
        curve, asked = options.gamma, ", as asked"
    kind = f"{8 * dtype.itemsize}-bit" if whole else "float"
    if curve == "srgb":
        conversions.append(f"{kind} values decoded as sRGB{asked}")
    elif curve == 1:
        conversions.append(f"{kind} values taken as linear{asked}")
    else:
        conversions.append(f"{kind} values decoded with gamma {curve:g}{asked}")
    return curve


def _choose_matrix(
    first: Image, encoding: Encoding, options: Options, conversions: list[str]
) -> np.ndarray | None:
    bands = first.bands
    if not isinstance(bands, str):
        if options.colour_space is not None:
            raise NacreError("images of spectra take no colour_space: their channels are their own")
        conversions.append(
            f"spectra of {len(bands)} bands from {bands[0]:g} to {bands[-1]:g} nm, seen under D65 "
            "by the CIE 1931 observer, to Rec.709; white, a flat spectrum of 1, is (1, 1, 1)"
        )
        return spectrum_to_rec709(bands).astype(np.float32)
    space, asked = "rec709", ""
    if bands == "XYZ":
        space = "xyz"
    elif first.pixels.dtype.kind == "f":
        space = encoding.float_space
    if options.colour_space is not None:
        space, asked = options.colour_space, ", as asked"
    if space == "xyz":
        conversions.append(f"CIE XYZ (D65) converted to Rec.709{asked}")
        return xyz_to_rec709().astype(np.float32)
    conversions.append(f"colours taken as Rec.709{asked}")
    return None


def _linear(encoded: np.ndarray, curve: float | str) -> np.ndarray:
    if curve == 1:
        return encoded
    if curve == "srgb":
        return srgb_to_linear(encoded).astype(encoded.dtype)
    return np.maximum(encoded, 0) ** encoded.dtype.type(curve)
