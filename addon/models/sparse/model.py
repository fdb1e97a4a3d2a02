"""A BTF as sparse codes of its patches in an ensemble of dictionaries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import NacreError
from ..clustered_tucker import Part, expand
from .ensemble import Ensemble
from .packing import value_bytes, values_of
from .patches import tiling
from .transform import CHANNELS, Normalisation, to_linear_rgb

COEFFICIENT_BYTES = 3
"""One for the value, which is one of 255, and two for the position (sparse.packing)."""

PATCH_BYTES = 4
"""The dictionary of a patch in one part of the ensemble."""


@dataclass(frozen=True)
class Codes:
    """Codes in one part of an ensemble.

    positions, values (coefficients, patches), the largest coefficient of each patch first: position
    is in C order of the ensemble's modes, unused values are 0. members (patches,): the dictionary.
    """

    positions: NDArray[np.uint32]
    values: NDArray[np.float32]
    members: NDArray[np.uint32]

    @property
    def largest(self) -> float:
        """The largest magnitude."""
        return float(np.abs(self.values).max(initial=0.0))

    def first(self, count: int) -> Codes:
        """The `count` most important coefficients of each patch."""
        return replace(self, positions=self.positions[:count], values=self.values[:count])

    def rounded(self) -> Codes:
        """With values of one byte (packing.value_bytes)."""
        values = values_of(value_bytes(self.values, self.largest), self.largest)
        order = np.lexsort((self.positions, -np.abs(values)), 0)  # of equal ones the first position
        positions = np.take_along_axis(self.positions, order, 0)
        return replace(self, positions=positions, values=np.take_along_axis(values, order, 0))


@dataclass(frozen=True)
class SparseBtf:
    """A BTF of height x width texels.

    codes     for each part of the ensemble; patches are side by side, row by row (`tiling`)
    dataset   what the decoded samples are: light, view, channels, patch_size, periodic, source ...
    fit       how it was made
    quality   latent-equivalents N: codes take at most 2 N bytes a texel (SparseBTF(N) of the paper)
    complete  whether these are all the coefficients that were kept
    """

    height: int
    width: int
    ensemble: Ensemble
    normalised: Normalisation
    codes: Mapping[str, Codes]
    dataset: Mapping[str, Any]
    fit: Mapping[str, Any] = field(default_factory=dict)
    quality: int = 0
    complete: bool = True
    kind: str = "btf"
    modes: tuple[str, ...] = ("light", "view", "y", "x")

    @property
    def shape(self) -> tuple[int, ...]:
        """The decoded samples' shape (light, view, y, x, channel)."""
        lights, views = self.normalised.deviation.shape
        return (lights, views, self.height, self.width, len(CHANNELS))

    @property
    def channels(self) -> int:
        """Colour channels."""
        return len(CHANNELS)

    @property
    def sparsity(self) -> dict[str, int]:
        """The most coefficients of a patch, in each part."""
        return {key: len(codes.values) for key, codes in self.codes.items()}

    @property
    def code_bytes(self) -> int:
        """Values, positions and membership as they are packed."""
        return sum(
            codes.values.size * COEFFICIENT_BYTES + len(codes.members) * PATCH_BYTES
            for codes in self.codes.values()
        )

    @cached_property
    def _origins(self) -> NDArray[np.intp]:
        return np.array(tiling(self.height, self.width, self.ensemble.patch))

    def decode(
        self,
        light: Part = slice(None),
        view: Part = slice(None),
        y: Part = slice(None),
        x: Part = slice(None),
    ) -> NDArray[np.float32]:
        """Linear samples (light, view, y, x, channel) of one block, float32, unclamped (Eq. 4)."""
        return to_linear_rgb(self.logarithms(light, view, y, x), self.normalised.offset)

    def logarithms(
        self,
        light: Part = slice(None),
        view: Part = slice(None),
        y: Part = slice(None),
        x: Part = slice(None),
    ) -> NDArray[np.float32]:
        """Y, U, V of the logarithm (transform.to_log_yuv) of one block, as `decode` takes it."""
        parts = (light, view, y, x)
        lights, views, ys, xs = (
            np.arange(size)[part] for size, part in zip(self.shape[:4], parts, strict=True)
        )
        values = np.zeros((len(lights), len(views), len(ys), len(xs), len(CHANNELS)), np.float32)
        tall, wide = self.ensemble.patch
        for index, (first_y, first_x) in enumerate(self._origins):
            in_y = np.flatnonzero((ys >= first_y) & (ys < first_y + tall))
            in_x = np.flatnonzero((xs >= first_x) & (xs < first_x + wide))
            if len(in_y) and len(in_x):
                rows = (ys[in_y] - first_y, xs[in_x] - first_x, lights, views)
                block = np.moveaxis(self._decode_patch(index, rows), (2, 3), (0, 1))
                values[:, :, in_y[:, None], in_x] = block
        return self.normalised.logarithms(values, lights, views)

    def texel(self, light: int, view: int, y: int, x: int) -> NDArray[np.float32]:
        """The colour (3,) of one texel for one light and view, from its patch's coefficients alone
        (Eq. 5): what a shader computes."""
        return to_linear_rgb(self.texel_logarithm(light, view, y, x), self.normalised.offset)

    def texel_logarithm(self, light: int, view: int, y: int, x: int) -> NDArray[np.float32]:
        """Y, U, V (3,) of the logarithm of `texel`."""
        tall, wide = self.ensemble.patch
        patch = y // tall * -(-self.width // wide) + x // wide
        values = np.zeros(len(CHANNELS), np.float32)
        for key, codes in self.codes.items():
            dictionaries, member = self.ensemble.dictionaries[key], codes.members[patch]
            places = np.unravel_index(codes.positions[:, patch], self.ensemble.atoms(key))
            product = codes.values[:, patch]
            for row, place, matrices in zip(
                (y % tall, x % wide, light, view), places, dictionaries, strict=False
            ):
                product = product * matrices[member, row, place]
            if len(key) > 1:
                values += dictionaries[-1][member][:, places[-1]] @ product
            else:
                values[CHANNELS.index(key)] = product.sum()
        whole = values.reshape(1, 1, -1)
        return self.normalised.logarithms(whole, np.array([light]), np.array([view]))[0, 0]

    def normalised_patch(self, index: int) -> NDArray[np.float32]:
        """Normalised Y, U, V of a whole patch, also of what is over the edge: (y, x, light, view,
        3)."""
        lights, views = self.normalised.deviation.shape
        sizes = (*self.ensemble.patch, lights, views)
        return self._decode_patch(index, tuple(np.arange(size) for size in sizes))

    def _decode_patch(self, index: int, rows: tuple[NDArray[np.intp], ...]) -> NDArray[np.float32]:
        """Normalised Y, U, V of some rows of each mode of a patch: (y, x, light, view, 3)."""
        parts = []
        for key, codes in self.codes.items():
            dictionaries, member = self.ensemble.dictionaries[key], codes.members[index]
            places = np.unravel_index(codes.positions[:, index], self.ensemble.atoms(key))
            # Of a mode's atoms a patch uses some.
            used = [np.unique(own, return_inverse=True) for own in places]
            core = np.zeros([len(atoms) for atoms, _ in used], np.float32)
            # Unused values are 0 at position 0, where there may be a coefficient.
            np.add.at(core, tuple(ranks for _, ranks in used), codes.values[:, index])
            every = (*rows, np.arange(3))  # colour is a mode of some
            factors = [
                matrices[member][np.ix_(own, atoms)]
                for matrices, own, (atoms, _) in zip(dictionaries, every, used, strict=False)
            ]
            found = expand(core, factors)
            parts.append(found if len(key) > 1 else found[..., None])
        return np.concatenate(parts, -1)

    def truncated(self, quality: int) -> SparseBtf:
        """The model with no more than `quality` latent-equivalents: the most important ones of
        every patch's coefficients, as many of each (`counts_at`)."""
        if quality >= self.quality:
            return self
        counts = counts_at(self.sparsity, quality, self.ensemble.patch)
        codes = {key: own.first(counts[key]) for key, own in self.codes.items()}
        return replace(self, codes=codes, quality=quality, complete=False)


def shares(sparsity: Mapping[str, int], share: float) -> dict[str, int]:
    """A share of each part's coefficients, at least one."""
    return {key: max(1, int(count * share + 1e-9)) for key, count in sparsity.items()}


def quality_of(sparsity: Mapping[str, int], patch: tuple[int, int]) -> int:
    """Latent-equivalents N: the least for which codes take at most 2 N bytes a texel."""
    size = COEFFICIENT_BYTES * sum(sparsity.values()) + PATCH_BYTES * len(sparsity)
    return -(-size // (2 * prod(patch)))


def counts_at(sparsity: Mapping[str, int], quality: int, patch: tuple[int, int]) -> dict[str, int]:
    """How many of a model's coefficients a lower quality has: the same share of each part's, but at
    least one, and all of them at the model's own quality."""
    room = _room(quality, len(sparsity), patch)
    return shares(sparsity, min(1.0, room / sum(sparsity.values())))


def room_of(quality: int, keys: tuple[str, ...], patch: tuple[int, int]) -> int:
    """How many coefficients of a patch take at most 2 N bytes a texel, all parts together.

    NacreError where not even one for each part does."""
    room = _room(quality, len(keys), patch)
    if room < len(keys):
        raise NacreError(
            f"quality {quality}: one coefficient of each of {', '.join(keys)} in patches of "
            f"{patch[1]} x {patch[0]} texels is quality {quality_of(dict.fromkeys(keys, 1), patch)}"
        )
    return room


def _room(quality: int, parts: int, patch: tuple[int, int]) -> int:
    return (2 * quality * prod(patch) - PATCH_BYTES * parts) // COEFFICIENT_BYTES
