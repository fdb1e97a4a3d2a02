"""Writes small FMF, PVF and BDI files field by field, and says what a reader must make of them."""

import bz2
import struct
from dataclasses import dataclass

import numpy as np
from btf_writer import LOG_OFFSET, SCALARS, BtfFile


@dataclass
class FmfFile(BtfFile):
    """One factorisation for all channels; `most` of the components count."""

    signature: bytes = b"!FMF12FCER"
    fmf_version: int = 2
    logarithms: int = 0
    height_map: tuple[int, int] = (0, 0)
    scalar: int = 4
    stored: int = 4
    most: int = 4

    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """(view, light, channel, component) and (y, x, component), as the file's scalars."""
        rng = np.random.default_rng(self.seed)
        channels = len(self.channel_names)
        shape = (len(self.view), len(self.light), channels, self.stored)
        directions = rng.normal(0, self.scale, shape).astype(SCALARS[self.scalar])
        texels = rng.normal(0, self.texel_scale, (self.height, self.width, self.stored))
        if self.transposed:  # the channel is then among the texels' rows
            directions = directions[:, :, :1]
            texels = rng.normal(
                0, self.texel_scale, (self.height, self.width, channels, self.stored)
            )
        return directions, texels.astype(SCALARS[self.scalar])

    def to_bytes(self) -> bytes:
        data = self.front()
        if b"E" in self.signature:
            data += struct.pack("<B", self.fmf_version)
            if self.fmf_version > 0:
                data += struct.pack("<I", self.logarithms)
            if self.fmf_version > 1:
                data += struct.pack("<2I", *self.height_map)
                data += bytes(2 * self.height_map[0] * self.height_map[1])
        u, v = (part.reshape(-1, self.stored) for part in self.matrices())
        if self.transposed:
            u, v = v, u
        data += struct.pack("<IB3I", self.most, self.scalar, self.stored, len(u), len(v))
        data += np.ones(self.stored, SCALARS[self.scalar]).tobytes() + u.tobytes() + v.tobytes()
        return data + self.trailing

    def expected(self, times_cosine: bool = False) -> np.ndarray:
        directions, texels = (
            part[..., : max(self.most, 1)].astype(float) for part in self.matrices()
        )
        if self.transposed:
            samples = np.einsum("vlok,yxck->lvyxc", directions, texels)
        else:
            samples = np.einsum("vlck,yxk->lvyxc", directions, texels)
        if self.logarithms:
            samples = np.exp(samples) - LOG_OFFSET
        return samples * cosines(self, times_cosine)


@dataclass
class PvfFile(BtfFile):
    """A factorisation for each view, each of another number of components."""

    signature: bytes = b"!PVF06FCR"
    oldest: bool = False
    scalar: int = 4
    slots: int | None = None

    def matrices(self, view: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mean, components and weights of a view as the file's scalars; rows are (light, channel),
        of a transposed file (texel, channel)."""
        rng = np.random.default_rng(self.seed + view)
        lights, texels = len(self.light), self.width * self.height
        rows, weights = (texels, lights) if self.transposed else (lights, texels)
        rows *= len(self.channel_names)
        count = 2 + view
        parts = (
            rng.normal(0.5, 0.1, rows),
            rng.normal(0, self.scale, (rows, count)),
            rng.normal(0, self.texel_scale, (weights, count)),
        )
        return tuple(part.astype(SCALARS[self.scalar]) for part in parts)

    def to_bytes(self) -> bytes:
        slots = len(self.view) if self.slots is None else self.slots
        if self.oldest:
            data = self.signature + struct.pack("<2I", 301074, 9)
            data += self.size() + struct.pack("<I", slots) + self.directions()
        else:
            data = self.front() + struct.pack("<2I", 9, slots)
        for view in range(slots):
            mean, components, weights = self.matrices(view)
            count = components.shape[1]
            data += struct.pack("<B3I", self.scalar, count, len(weights), len(components))
            data += np.ones(count, SCALARS[self.scalar]).tobytes()
            data += mean.tobytes() + components.tobytes() + weights.tobytes()
        return data + self.trailing

    def expected(self, times_cosine: bool = False) -> np.ndarray:
        shape = (len(self.light), len(self.view), self.height, self.width, len(self.channel_names))
        samples = np.zeros(shape)
        for view in range(len(self.view)):
            mean, components, weights = (part.astype(float) for part in self.matrices(view))
            values = mean + weights @ components.T
            if self.transposed:  # (light, (y, x, channel))
                samples[:, view] = values.reshape(shape[0], *shape[2:])
            else:  # ((y, x), (light, channel))
                by_texel = values.reshape(*shape[2:4], shape[0], shape[4])
                samples[:, view] = by_texel.transpose(2, 0, 1, 3)
        return samples * cosines(self, times_cosine)


@dataclass
class BdiFile(BtfFile):
    """All samples as half floats, some scan lines in a chunk; `mask` has the texels there are."""

    signature: bytes = b"!BDIF06R2!"
    lines: int = 3
    compression: int = 2
    mask: np.ndarray | None = None

    def samples(self) -> np.ndarray:
        """(y, x, view, light, channel) float16."""
        shape = (self.height, self.width, len(self.view), len(self.light), len(self.channel_names))
        return np.random.default_rng(self.seed).normal(0.5, self.scale, shape).astype("<f2")

    def there(self) -> np.ndarray:
        """(y, x): which texels the mask has."""
        return np.ones((self.height, self.width), bool) if self.mask is None else self.mask

    def chunks(self) -> list[bytes]:
        texels = self.samples().reshape(self.width * self.height, -1)
        if self.compression == 2:
            texels = texels[self.there().ravel()]
        step = self.lines * self.width
        parts = [texels[i : i + step].tobytes() for i in range(0, len(texels), step)]
        return [bz2.compress(part) for part in parts] if self.compression == 1 else parts

    def to_bytes(self) -> bytes:
        data = self.signature + self.header() + self.directions() + self.size()
        data += struct.pack("<IB", self.lines, self.compression)
        data += self.there().astype(np.uint8).tobytes() + self.turned()
        for chunk in self.chunks():
            data += struct.pack("<I", len(chunk)) + chunk
        return data + self.trailing

    def expected(self, times_cosine: bool = False) -> np.ndarray:
        samples = self.samples().astype(float)
        if self.compression == 2:
            samples[~self.there()] = 0
        return samples.transpose(3, 2, 0, 1, 4) * cosines(self, times_cosine)


def cosines(file: BtfFile, wanted: bool) -> np.ndarray:
    """What to multiply samples (light, ...) by."""
    theta = np.array([theta for theta, _ in file.light])
    return (np.cos(theta) if wanted else np.ones(len(theta))).reshape(-1, 1, 1, 1, 1)
