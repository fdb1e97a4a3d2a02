"""Writes small DFMF files field by field, and says what a reader must make of them."""

import struct
from dataclasses import dataclass, field

import numpy as np

SCALARS = {2: "<f2", 4: "<f4", 8: "<f8"}
YUV_TO_RGB = np.array([[1, 0, 1.13983], [1, -0.39465, -0.5806], [1, 2.03211, 0]])
LOG_OFFSET = 1e-5


@dataclass
class BtfFile:
    """A DFMF file; the defaults are a usual one. Directions are (theta, phi) in radians."""

    signature: bytes = b"!DFMF08FCR"
    version: int = 2
    cosine_flag: int = 1
    pixels_per_mm: float = 10.0
    rgb_scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    xml: bytes = b"<measurement/>"
    channel_names: tuple[bytes, ...] = (b"R", b"G", b"B")
    added_to_header: bytes = b""
    light: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.5, 1.0), (1.2, -2.0))
    view: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.9, 3.0))
    other_light: dict[int, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    width: int = 5
    height: int = 4
    rotations: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    colour_model: int = 0
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    matrix: np.ndarray = field(default_factory=lambda: np.eye(3))
    scalars: tuple[int, ...] = (4, 4, 4)
    components: tuple[int, ...] = (3, 2, 1)
    transposed: bool = False
    trailing: bytes = b""
    seed: int = 7
    scale: float = 1.0
    texel_scale: float = 0.4

    def factors(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """(directions, texels) of each stored channel, as the file's scalars hold them."""
        rng = np.random.default_rng(self.seed)
        pairs = len(self.light) * len(self.view)
        texels = self.width * self.height
        result = []
        for scalar, count in zip(self.scalars, self.components, strict=True):
            directions = rng.normal(0, self.scale, (pairs, count))
            positions = rng.normal(0, self.texel_scale, (texels, count))
            result.append((directions.astype(SCALARS[scalar]), positions.astype(SCALARS[scalar])))
        return result

    def header(self) -> bytes:
        data = struct.pack("<I", self.version)
        data += b"setup".ljust(80, b"\0") + b"sensor".ljust(80, b"\0") + b"sun".ljust(80, b"\0")
        data += struct.pack("<4f", self.pixels_per_mm, *self.rgb_scale)
        if self.version > 1:
            data += struct.pack("<I", self.cosine_flag)
        if self.version > 2:
            data += struct.pack("<I", len(self.xml)) + self.xml
        if self.version > 3:
            data += struct.pack("<I", len(self.channel_names))
            for name in self.channel_names:
                data += struct.pack("<I", len(name)) + name
        data += self.added_to_header
        return struct.pack("<I", 4 + len(data)) + data

    def directions(self) -> bytes:
        data = struct.pack("<I", len(self.view))
        for index, (theta, phi) in enumerate(self.view):
            lights = self.other_light.get(index, self.light)
            data += struct.pack("<2fI", theta, phi, len(lights))
            data += np.array(lights, "<f4").tobytes()
        return data

    def size(self) -> bytes:
        return struct.pack("<2I", self.width, self.height)

    def turned(self) -> bytes:
        return struct.pack("<I", len(self.rotations)) + self.rotations.astype("<f4").tobytes()

    def front(self) -> bytes:
        """All that the layouts share."""
        data = self.signature + self.header() + self.directions() + self.size()
        return data + (self.turned() if self.signature.endswith(b"R") else b"")

    def to_bytes(self) -> bytes:
        data = self.front()
        data += struct.pack("<Ii", max(self.components), self.colour_model)
        data += struct.pack("<12f", *self.mean, *self.matrix.ravel())
        for scalar, (directions, texels) in zip(self.scalars, self.factors(), strict=True):
            u, sxv = (texels, directions) if self.transposed else (directions, texels)
            data += struct.pack("<B3I", scalar, u.shape[1], len(u), len(sxv))
            data += np.ones(u.shape[1], SCALARS[scalar]).tobytes() + u.tobytes() + sxv.tobytes()
        return data + self.trailing

    def expected(self, times_cosine: bool = False) -> np.ndarray:
        """Samples (light, view, y, x, channel) float64, worked out one value at a time."""
        shape = (len(self.light), len(self.view), self.height, self.width)
        factors = self.factors()
        samples = np.zeros((*shape, len(factors)))
        for light, view, y, x in np.ndindex(shape):
            row = view * len(self.light) + light
            column = y * self.width + x
            stored = [
                float(np.dot(u[row].astype(float), v[column].astype(float))) for u, v in factors
            ]
            value = self._linear(stored)
            if times_cosine:
                value = value * np.cos(self.light[light][0])
            samples[light, view, y, x] = value
        return samples

    def _linear(self, stored: list[float]) -> np.ndarray:
        """Decoded channels, in the order of their names where the model keeps them."""
        a, b, c = stored[:3]
        match self.colour_model:
            case 0:
                return np.array(stored)
            case 1:
                return YUV_TO_RGB @ stored
            case 2:
                return lab_to_linear(a, b, c)
            case 3:
                return np.array(stored) @ self.matrix.astype(np.float32) + self.mean
            case 4:
                return np.array([a + b - c, a + c, a - b - c])
            case 5:
                return a * np.array([1 - sum(stored[1:]), *stored[1:]])
            case 6:
                total = a * len(stored)
                others = [total * (1 + value) for value in stored[1:]]
                return np.array([total - sum(stored[1:]) / len(stored), *others])
            case 9:
                return YUV_TO_RGB @ [np.exp(a) - LOG_OFFSET, b, c]
            case 10:
                chroma = [
                    np.sign(value) * np.exp(abs(value) + np.log(LOG_OFFSET)) for value in (b, c)
                ]
                return YUV_TO_RGB @ [np.exp(a) - LOG_OFFSET, *chroma]
            case 11:
                return YUV_TO_RGB @ [np.exp(a) - LOG_OFFSET, b * np.exp(a), c * np.exp(a)]
            case 12:
                return np.exp(stored) - LOG_OFFSET
        raise AssertionError(self.colour_model)


def lab_to_linear(lightness: float, a: float, b: float) -> np.ndarray:
    """CIE Lab of white D50 to linear Rec.709, all matrices worked out here."""

    def uncurved(value: float) -> float:
        return value**3 if value > 6 / 29 else (value - 16 / 116) * 108 / 841

    fy = (lightness + 16) / 116
    d50, d65 = np.array([0.9642, 1.0, 0.8249]), np.array([0.95047, 1.0, 1.08883])
    xyz = d50 * [uncurved(fy + a / 500), uncurved(fy), uncurved(fy - b / 200)]
    bradford = np.array(
        [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
    )
    cones = (bradford @ xyz) * (bradford @ d65) / (bradford @ d50)
    primaries = np.array([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]])
    columns = np.array([[x / y, 1, (1 - x - y) / y] for x, y in primaries]).T
    rgb_to_xyz = columns * np.linalg.solve(columns, d65)
    return np.linalg.solve(rgb_to_xyz, np.linalg.solve(bradford, cones))
