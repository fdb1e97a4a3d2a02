"""BRDFs of the RGL database, `.bsdf`, and polarimetric ones of KAIST, `.pbsdf`.

Both are tensor files (see `tensor_file`), told apart by their fields.

Dupuy and Jakob, "An Adaptive Parameterization for Efficient Material Acquisition and Rendering",
2018: theta_i, phi_i; ndf and sigma (phi, theta); vndf (phi_i, theta_i, phi, theta); rgb or spectra
(phi_i, theta_i, channel, y, x), with wavelengths in nm. The colour is looked up where the density
vndf of the half vector is uniform. Directions on the tables are sqrt(2 theta / pi) and
(phi + pi) / 2 pi. The first direction, i, is the view, as in Mitsuba's `measured`: what is stored
is f_r cos(theta) of the other one, the light.

Baek et al., "Image-Based Acquisition and Modeling of Polarimetric Reflectance", 2020: M (phi_d,
theta_d, theta_h, wavelength, 4, 4), Mueller matrices of f_r; the first element is what unpolarised
light gives. NaN is what could not be measured; it counts as 0, as in Mitsuba.
"""

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import NacreError
from .brdf.bilinear import Warp, blend, interpolate
from .brdf.tensor_file import MAGIC, Field, TensorFile, open_tensor_file
from .brdf.uniform import OPTIONS as OPTIONS
from .brdf.uniform import Evaluate, elevation, half_difference, half_vector, uniform_source
from .colour import spectrum_to_rec709
from .options import Options
from .source import Source

FORMAT = "rgl"
EXTENSIONS = (".bsdf", ".pbsdf")

# Real files have 195.
_MOST_WAVELENGTHS = 512

# Parts of the turn that are too small to tell azimuths apart.
_SAME_AZIMUTH = 1e-9


def matches(path: Path) -> bool:
    """Whether the file starts as a tensor file does."""
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False


def open_source(path: Path, options: Options) -> Source:
    """Read the list of fields, check their shapes against each other, and read the parameters.

    Raises NacreError for a file that is no tensor file, is cut short, or lacks what a BRDF needs.
    """
    try:
        file = open_tensor_file(path)
        polarised = "M" in file.fields
        brdf = _open_polarised(file) if polarised else _open_adaptive(file)
    except OSError as error:
        raise NacreError(f"cannot read {path}: {error.strerror}") from error
    return uniform_source(
        path,
        FORMAT,
        options,
        file.bytes,
        brdf.conversions,
        brdf.details(),
        brdf.memory,
        partial(_load, brdf),
    )


def _load(brdf: "_Adaptive | _Polarised") -> Evaluate:
    return brdf.evaluator(brdf.to_rgb())


def _wavelengths(file: TensorFile, name: str, dtype: str) -> np.ndarray:
    field = file.field(name, dtype, 1)
    if field.shape[0] > _MOST_WAVELENGTHS:
        raise NacreError(
            f"{file.path.name} has {field.shape[0]} wavelengths in the field {name}; up to "
            f"{_MOST_WAVELENGTHS} are read"
        )
    return _increasing(file.read(field), name, file.path.name)


def _colours(wavelengths: np.ndarray) -> list[str]:
    return [
        f"spectra of {len(wavelengths)} bands from {wavelengths[0]:g} to {wavelengths[-1]:g} nm, "
        "seen under D65 by the CIE 1931 observer, to Rec.709; white, a flat spectrum of 1, is "
        "(1, 1, 1)"
    ]


def _increasing(values: np.ndarray, field: str, name: str) -> np.ndarray:
    """A parameter's values in double precision; NacreError when they are no grid."""
    with np.errstate(invalid="ignore"):
        values = values.astype(np.float64).reshape(-1)
        grid = len(values) and np.isfinite(values).all() and (np.diff(values) > 0.0).all()
    if not grid:
        raise NacreError(f"{name} is damaged: the values of the field {field} do not increase")
    return values


# --- RGL ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Adaptive:
    """A file of the database; `colour` is the field of values, `wavelengths` of spectra in nm."""

    file: TensorFile
    theta_i: np.ndarray
    phi_i: np.ndarray
    tables: dict[str, Field]
    colour: Field
    wavelengths: np.ndarray | None
    jacobian: bool
    conversions: list[str]

    @property
    def isotropic(self) -> bool:
        return len(self.phi_i) <= 2

    @property
    def symmetry(self) -> int:
        """1, or how many times an anisotropic file's range of phi_i goes into the turn."""
        if self.isotropic:
            return 1
        return round(2.0 * math.pi / (self.phi_i[-1] - self.phi_i[0]))

    @property
    def memory(self) -> int:
        """Of the warp, which is made in double precision, and of the colours."""
        warped = math.prod(self.tables["vndf"].shape)
        phis, thetas, channels, height, width = self.colour.shape
        return 56 * warped + 4 * height * width * (3 * phis * thetas + 3 * channels)

    def details(self) -> dict[str, Any]:
        return {
            "brdf": "isotropic" if self.isotropic else "anisotropic",
            "tables": {name: list(field.shape) for name, field in self.tables.items()},
            self.colour.name: list(self.colour.shape),
        }

    def to_rgb(self) -> np.ndarray:
        """What makes red, green and blue of the channels (3, channels)."""
        return (
            np.eye(3) if self.wavelengths is None else spectrum_to_rec709(self.wavelengths.tolist())
        )

    def evaluator(self, mixing: np.ndarray) -> Evaluate:
        """Of the channels mixed by (n, channels)."""
        vndf = self._table("vndf")
        warp = Warp(vndf.reshape(-1, *vndf.shape[2:]))
        ndf, sigma = (self._table(name).astype(np.float64)[None] for name in ("ndf", "sigma"))
        colour = self._mixed(mixing)

        def evaluate(light: np.ndarray, view: np.ndarray) -> np.ndarray:
            light, view = self._mirrored(light, view)
            half = half_vector(light, view)
            theta_i, phi_i = elevation(view), np.arctan2(view[:, 1], view[:, 0])
            theta_m, phi_m = elevation(half), np.arctan2(half[:, 1], half[:, 0])
            x = _theta_to_unit(theta_m)
            y = _phi_to_unit(phi_m - phi_i if self.isotropic else phi_m)
            # Both ends of the turn are one azimuth: which of them is not left to the last bit, that
            # numpy's arctan2 rounds as memory happens to lie.
            y -= np.floor(y + _SAME_AZIMUTH)
            slices = blend([(self.phi_i, phi_i), (self.theta_i, theta_i)])
            values = interpolate(colour, *warp(x, y, slices), slices)
            if self.jacobian:
                one = blend([(np.zeros(1), x)])
                area = interpolate(sigma, _theta_to_unit(theta_i), _phi_to_unit(phi_i), one)
                density = interpolate(ndf, x, y, one)
                scale = np.divide(density, 4.0 * area, out=np.zeros_like(area), where=area > 0.0)
                values *= scale[:, None]
            result: np.ndarray = np.pi * values
            return result

        return evaluate

    def _table(self, name: str) -> np.ndarray:
        values = self.file.read(self.tables[name])
        if not (np.isfinite(values).all() and (values >= 0.0).all()):
            raise NacreError(
                f"{self.file.path.name} is damaged: the field {name} holds negative values, or "
                "some that are no numbers"
            )
        return values

    def _mixed(self, mixing: np.ndarray) -> np.ndarray:
        """Colours (slices, y, x, n), read slice by slice; negative values and NaN count as 0."""
        phis, thetas, channels, height, width = self.colour.shape
        stored = self.file.map(self.colour).reshape(-1, channels, height, width)
        mixed = np.empty((phis * thetas, height, width, len(mixing)), np.float32)
        for number, values in enumerate(stored):
            values = np.where(values > 0.0, values, np.float32(0.0))
            mixed[number] = np.einsum("nc,cyx->yxn", mixing.astype(np.float32), values)
        return mixed

    def _mirrored(self, light: np.ndarray, view: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Directions turned to where the file has phi_i: half or a quarter of the turn.

        A sign of zero counts as one of the number.
        """
        if self.symmetry < 2:
            return light, view
        flip_y = ~np.signbit(view[:, 1])
        flip_x = ~np.signbit(view[:, 0]) if self.symmetry == 4 else flip_y
        signs = np.where(np.stack([flip_x, flip_y, np.zeros_like(flip_x)], -1), -1.0, 1.0)
        return light * signs, view * signs


def _theta_to_unit(theta: np.ndarray) -> np.ndarray:
    return np.sqrt(theta * (2.0 / np.pi))


def _phi_to_unit(phi: np.ndarray) -> np.ndarray:
    unit: np.ndarray = (phi + np.pi) / (2.0 * np.pi)
    return unit


def _open_adaptive(file: TensorFile) -> _Adaptive:
    name = file.path.name
    theta_i, phi_i = (
        _increasing(file.read(file.field(key, "f4", 1)), key, name) for key in ("theta_i", "phi_i")
    )
    axes = {"ndf": 2, "sigma": 2, "vndf": 4}
    tables = {key: file.field(key, "f4", count) for key, count in axes.items()}
    slices = (len(phi_i), len(theta_i))
    if "spectra" in file.fields:
        wavelengths = _wavelengths(file, "wavelengths", "f4")
        colour, channels = file.field("spectra", "f4", 5), len(wavelengths)
        conversions = _colours(wavelengths)
    else:
        wavelengths, channels = None, 3
        colour = file.field("rgb", "f4", 5)
        conversions = ["rgb taken as linear Rec.709"]
    expected = {"vndf": slices, colour.name: (*slices, channels)}
    for field in (*tables.values(), colour):
        start = expected.get(field.name, ())
        if field.shape[: len(start)] != start or min(field.shape[-2:]) < 2:
            wanted = ", ".join([*map(str, start), "2 or more", "2 or more"])
            raise NacreError(
                f"{name} is damaged: the field {field.name} has the shape {field.shape}; expected "
                f"({wanted})"
            )
    jacobian = file.read(file.field("jacobian", "u1", 1))
    if len(jacobian) != 1:
        raise NacreError(f"{name} is damaged: the field jacobian holds {len(jacobian)} values")
    conversions.append("f_r cos(theta_light) multiplied by pi; theta_i and phi_i taken as the view")
    return _Adaptive(
        file, theta_i, phi_i, tables, colour, wavelengths, bool(jacobian[0]), conversions
    )


# --- polarimetric ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Polarised:
    """A polarimetric BRDF; `axes` are phi_d, theta_d and theta_h in radians."""

    file: TensorFile
    axes: tuple[np.ndarray, ...]
    wavelengths: np.ndarray
    mueller: Field
    conversions: list[str]

    @property
    def memory(self) -> int:
        return 0  # mapped

    def details(self) -> dict[str, Any]:
        return {"brdf": "isotropic, polarimetric", "M": list(self.mueller.shape)}

    def to_rgb(self) -> np.ndarray:
        return spectrum_to_rec709(self.wavelengths.tolist())

    def evaluator(self, mixing: np.ndarray) -> Evaluate:
        # Mapped: files are of a gigabyte, and few of its numbers are wanted.
        stored = self.file.map(self.mueller)[..., 0, 0]
        stored = stored.reshape(-1, len(self.wavelengths))

        def evaluate(light: np.ndarray, view: np.ndarray) -> np.ndarray:
            theta_h, theta_d, phi_d = half_difference(light, view)
            grid = blend(list(zip(self.axes, (phi_d, theta_d, theta_h), strict=True)))
            spectra = np.zeros((len(view), len(self.wavelengths)))
            for slices, weights in zip(grid.slices, grid.weights[..., None], strict=True):
                spectra += np.where(weights > 0.0, weights * stored[slices], 0.0)
            spectra = np.where(np.isnan(spectra), 0.0, np.maximum(spectra, 0.0))
            values: np.ndarray = spectra @ mixing.T * (np.pi * light[:, 2:])
            return values

        return evaluate


def _open_polarised(file: TensorFile) -> _Polarised:
    name = file.path.name
    axes = []
    for key in ("phi_d", "theta_d", "theta_h"):
        field = file.field(key, "f4", 2)
        if field.shape[0] > 1:
            raise NacreError(
                f"{name} is damaged: the field {key} has the shape {field.shape}; expected one row"
            )
        # Files exist whose shape is (0, n), with n values all the same.
        listed = file.reshaped(field, field.shape[1:])
        axes.append(_increasing(file.read(listed), key, name))
    wavelengths = _wavelengths(file, "wvls", "u2")
    mueller = file.field("M", "f4", 6)
    expected = (*map(len, axes), len(wavelengths), 4, 4)
    if mueller.shape != expected:
        raise NacreError(
            f"{name} is damaged: the field M has the shape {mueller.shape}; expected {expected}"
        )
    conversions = [
        "the Mueller matrices' first element taken: f_r for unpolarised light; NaN taken as 0",
        *_colours(wavelengths),
        "multiplied by pi cos(theta_light)",
    ]
    return _Polarised(file, tuple(axes), wavelengths, mueller, conversions)
