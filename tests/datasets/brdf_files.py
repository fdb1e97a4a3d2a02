"""Writes BRDFs in the formats of the RGL, KAIST, MERL and UTIA databases."""

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

TYPES = {"u1": 1, "i1": 2, "u2": 3, "i2": 4, "u4": 5, "i4": 6, "u8": 7, "i8": 8}
TYPES |= {"f2": 9, "f4": 10, "f8": 11}


def tensor_file(fields: dict[str, np.ndarray], shapes: dict[str, tuple] | None = None) -> bytes:
    """A tensor file; `shapes` replaces those that are written of some fields."""
    head = b"tensor_file\0\1\0" + struct.pack("<I", len(fields))
    listed = [(name, np.ascontiguousarray(values)) for name, values in fields.items()]
    written = {name: (shapes or {}).get(name, values.shape) for name, values in listed}
    start = len(head) + sum(
        2 + len(name.encode()) + 2 + 1 + 8 + 8 * len(written[name]) for name, _ in listed
    )
    data = b""
    for name, values in listed:
        data += bytes(-(start + len(data)) % 8)
        encoded, kind = name.encode(), values.dtype.str[1:]
        head += struct.pack("<H", len(encoded)) + encoded
        head += struct.pack("<HBQ", len(written[name]), TYPES[kind], start + len(data))
        head += struct.pack(f"<{len(written[name])}Q", *written[name])
        data += values.tobytes()
    return head + data


@dataclass
class RglFile:
    """A BRDF of the RGL database with random tables. `symmetry` is 0 for an isotropic one."""

    symmetry: int = 0
    wavelengths: tuple[float, ...] = ()
    jacobian: bool = True
    thetas: int = 4
    phis: int = 5
    size: int = 6
    warp: tuple[int, int] = (7, 9)
    seed: int = 1
    changes: dict[str, np.ndarray | None] = field(default_factory=dict)

    def fields(self) -> dict[str, np.ndarray]:
        rng = np.random.default_rng(self.seed)
        phi = np.zeros(1)
        if self.symmetry:
            phi = np.linspace(-np.pi, -np.pi + 2 * np.pi / self.symmetry, self.phis)
        theta = np.linspace(0, 1.45, self.thetas) ** 1.2
        slices = (len(phi), len(theta))

        def table(*shape: int) -> np.ndarray:
            values = rng.uniform(0.1, 1.0, shape) ** 2
            if not self.symmetry and len(shape) == 2:
                values[:] = values[:1]  # Mitsuba mirrors the view of an isotropic file at will
            return values.astype("<f4")

        colours = len(self.wavelengths) or 3
        fields: dict[str, np.ndarray | None] = {
            "description": np.frombuffer(b"random", "u1"),
            "phi_i": phi.astype("<f4"),
            "theta_i": theta.astype("<f4"),
            "sigma": table(*self.warp),
            "ndf": table(*self.warp),
            "vndf": table(*slices, *self.warp),
            "luminance": table(*slices, self.size, self.size),
            "spectra" if self.wavelengths else "rgb": table(*slices, colours, self.size, self.size),
            "jacobian": np.array([self.jacobian], "u1"),
        }
        if self.wavelengths:
            fields["wavelengths"] = np.array(self.wavelengths, "<f4")
        fields |= self.changes
        return {name: values for name, values in fields.items() if values is not None}

    def to_bytes(self) -> bytes:
        return tensor_file(self.fields())


@dataclass
class PolarisedFile:
    """A polarimetric BRDF with random matrices on a coarse grid."""

    shape: tuple[int, int, int] = (9, 5, 6)
    wavelengths: tuple[int, ...] = (450, 500, 550, 600, 650)
    invalid: int = 0
    empty_axes: bool = True
    seed: int = 1
    changes: dict[str, np.ndarray | None] = field(default_factory=dict)

    def fields(self) -> dict[str, np.ndarray]:
        phis, difference, half = self.shape
        rng = np.random.default_rng(self.seed)
        mueller = rng.uniform(-0.2, 1.0, (*self.shape, len(self.wavelengths), 4, 4))
        cells = mueller.reshape(-1, len(self.wavelengths), 4, 4)
        cells[: self.invalid] = np.nan
        fields: dict[str, np.ndarray | None] = {
            "phi_d": np.linspace(-np.pi, np.pi, phis)[None].astype("<f4"),
            "theta_d": np.linspace(0, np.pi / 2, difference)[None].astype("<f4"),
            "theta_h": (np.linspace(0, 1, half)[None] ** 2 * np.pi / 2).astype("<f4"),
            "wvls": np.array(self.wavelengths, "<u2"),
            "M": mueller.astype("<f4"),
        }
        fields |= self.changes
        return {name: values for name, values in fields.items() if values is not None}

    def to_bytes(self) -> bytes:
        fields = self.fields()
        axes = ("theta_d", "theta_h") if self.empty_axes else ()
        return tensor_file(fields, {name: (0, fields[name].shape[-1]) for name in axes})


Brdf = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Lights and views (..., 3) -> f_r (..., 3)."""

MERL_SCALE = np.array([1.0, 1.15, 1.66]) / 1500


def merl_cells(phis: int = 180) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(theta_h, theta_d, phi_d) in the middle of each cell, (90, 90, phis) each."""
    turn = np.pi * phis / 180
    return tuple(
        np.meshgrid(
            ((np.arange(90) + 0.5) / 90) ** 2 * np.pi / 2,
            (np.arange(90) + 0.5) / 90 * np.pi / 2,
            (np.arange(phis) + 0.5) / phis * turn,
            indexing="ij",
        )
    )


def from_half_difference(
    theta_h: np.ndarray, theta_d: np.ndarray, phi_d: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Light and view (..., 3) whose half vector lies above +x."""
    light = np.stack(
        [np.sin(theta_d) * np.cos(phi_d), np.sin(theta_d) * np.sin(phi_d), np.cos(theta_d)], -1
    )
    view = light * [-1, -1, 1]
    result = []
    for direction in (light, view):
        x, y, z = np.moveaxis(direction, -1, 0)
        c, s = np.cos(theta_h), np.sin(theta_h)
        result.append(np.stack([c * x + s * z, y, c * z - s * x], -1))
    return result[0], result[1]


def merl_file(brdf: Brdf, phis: int = 180) -> bytes:
    """A BRDF where light and view are above the surface, else -1."""
    light, view = from_half_difference(*merl_cells(phis))
    values = brdf(light, view) / MERL_SCALE
    values[(light[..., 2] <= 0) | (view[..., 2] <= 0)] = -1.0
    header = struct.pack("<3i", 90, 90, phis)
    return header + np.ascontiguousarray(np.moveaxis(values, -1, 0), "<f8").tobytes()


def utia_directions() -> np.ndarray:
    """The 288 directions of a UTIA BRDF, theta slowest."""
    theta, phi = np.meshgrid(
        np.radians(np.arange(6) * 15.0), np.radians(np.arange(48) * 7.5), indexing="ij"
    )
    return np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1
    ).reshape(-1, 3)


def utia_file(brdf: Brdf) -> bytes:
    """A BRDF encoded as sRGB."""
    directions = utia_directions()
    values = brdf(directions[:, None], directions[None, :])
    encoded = np.where(
        values <= 0.0031308, 12.92 * values, 1.055 * np.abs(values) ** (1 / 2.4) - 0.055
    )
    return np.ascontiguousarray(np.moveaxis(encoded, -1, 0), "<f8").tobytes()


def lambert(light: np.ndarray, view: np.ndarray) -> np.ndarray:
    shape = np.broadcast_shapes(light.shape, view.shape)
    return np.broadcast_to(np.array([0.2, 0.5, 0.8]) / np.pi, shape).copy()


def blinn_phong(light: np.ndarray, view: np.ndarray) -> np.ndarray:
    """A broad lobe on a diffuse base; reciprocal."""
    half = light + view
    half = half / np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-9)
    lobe = np.maximum(half[..., 2:], 0.0) ** 20
    return np.array([0.1, 0.2, 0.3]) / np.pi + np.array([0.4, 0.3, 0.2]) * lobe


def anisotropic(light: np.ndarray, view: np.ndarray) -> np.ndarray:
    """Stretched along x, and another colour along y."""
    half = light + view
    half = half / np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-9)
    x, y, z = (half[..., i : i + 1] / np.maximum(half[..., 2:], 1e-3) for i in range(3))
    lobe = np.exp(-((x / 0.6) ** 2) - (y / 0.25) ** 2) * z
    return np.array([0.1, 0.2, 0.3]) / np.pi + np.array([0.3, 0.2, 0.1]) * lobe
