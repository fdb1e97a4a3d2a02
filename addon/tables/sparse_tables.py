"""Tables of a sparse model (SparseBTF): what its evaluators read.

With the coefficients j of the patch that a texel (y, x) lies in, for a light and a view direction,

    part(y, x, light, view) = sum over j of  value_j * texels[t_j, y, x] * light[l_j] * view[v_j]

for each of the parts Y, U and V (Eq. 5), with rows of light and view read between the texels of
parabolic maps: interpolation in coefficient space (Eq. 6). The part times the images' deviation
plus their mean, both sums of products of maps as well, is Y, U or V of the logarithm of the colour.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import prod

import numpy as np
from numpy.typing import NDArray

from ..models.interpolation import lowest
from ..models.sparse.interpolation import weights
from ..models.sparse.model import Codes, SparseBtf
from ..models.sparse.transform import CHANNELS
from .parabolic import texel_directions
from .tables import Tables, quads

Maps = NDArray[np.float32]

SIZE = 64
"""Texels along a direction map: rows are smooth between measured directions, and maps filtered."""

_IMAGES_ERROR = 1e-3
"""Root mean square of what means and deviations lack, against the largest of all channels: files'
half floats are off by a fifth of that."""


@dataclass(frozen=True)
class Part:
    """One of Y, U and V; all float32.

    coefficients (count, patches up, patches across, 4): value, and the rows of texels, light and
                 view that it multiplies; of each patch those of the channel's mean, if it has one
                 of its own, then the largest first, then zeros
    texels       (rows, patch height, patch width): products of columns of the y and x matrices
    light, view  (rows, N, N): columns of their matrices by parabolic texel, row = y
    """

    coefficients: NDArray[np.float32]
    texels: NDArray[np.float32]
    light: Maps
    view: Maps


@dataclass(frozen=True)
class Product:
    """A table (light, view) as a sum of products of maps: light, view (quads, N, N, 4) float32."""

    light: Maps
    view: Maps


@dataclass(frozen=True)
class SparseTables:
    """What an evaluator reads of one sparse model of height x width texels.

    parts   of "Y", "U" and "V"
    lowest  cosine of the lowest measured light: lower ones fade by cos / lowest (horizon_fade)
    offset  of the logarithm
    stand_in  tables of a tensor model that shaders show which cannot loop over coefficients
    """

    parts: dict[str, Part]
    mean: Product
    deviation: Product
    lowest: float
    offset: float
    height: int
    width: int
    stand_in: Tables | None = None

    @property
    def size(self) -> int:
        """Texels along a parabolic map."""
        return self.mean.light.shape[1]

    @property
    def patch(self) -> tuple[int, int]:
        """Height and width of a patch in texels."""
        height, width = next(iter(self.parts.values())).texels.shape[1:]
        return height, width

    @property
    def fetches(self) -> dict[str, int]:
        """Texels read for one light at one texel; of maps, filtered ones."""
        counts = sum(len(part.coefficients) for part in self.parts.values())
        images = len(self.mean.light) + len(self.deviation.light)
        return {
            "coefficients": counts,
            "texels": counts,
            "light": counts + images,
            "view": counts + images,
        }


def build_sparse_tables(
    model: SparseBtf,
    size: int = SIZE,
    kernel: str = "linear",
    progress: Callable[[float, str], bool] | None = None,
) -> SparseTables:
    """Resample a model's light and view matrices to direction maps of `size` by a kernel of
    models.sparse.interpolation. Raises Cancelled on request."""
    directions = texel_directions(size)
    return tables_at(model, directions, directions, kernel)


def tables_at(
    model: SparseBtf,
    lights: NDArray[np.floating],
    views: NDArray[np.floating],
    kernel: str = "linear",
) -> SparseTables:
    """Tables whose maps have the rows of the unit directions `lights` and `views` (N, N, 3)."""
    size = len(lights)
    by_light = weights(model.ensemble.light, lights.reshape(-1, 3), kernel)
    by_view = by_light
    if views is not lights or not np.array_equal(model.ensemble.view, model.ensemble.light):
        by_view = weights(model.ensemble.view, views.reshape(-1, 3), kernel)

    def maps(by: NDArray[np.float32], columns: NDArray[np.floating]) -> Maps:
        return np.ascontiguousarray((by @ columns).T, np.float32).reshape(-1, size, size)

    mean, more = means_apart(model)
    largest = float(np.abs(more).max(initial=0.0))
    parts = {
        key: _part(
            model, key, _products(table, largest), partial(maps, by_light), partial(maps, by_view)
        )
        for key, table in zip(CHANNELS, more, strict=True)
    }
    images = []
    for table in (mean, model.normalised.deviation):
        light, view = _products(table, float(np.abs(table).max(initial=0.0)))
        images.append(Product(_quads_of(maps(by_light, light)), _quads_of(maps(by_view, view))))
    return SparseTables(
        parts=parts,
        mean=images[0],
        deviation=images[1],
        lowest=lowest(np.asarray(model.ensemble.light)),
        offset=model.normalised.offset,
        height=model.height,
        width=model.width,
    )


def means_apart(model: SparseBtf) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The images' mean (light, view), and what more each channel has, normalised: (3, light, view).

    The authors have one mean of all channels. Where each has its own it is a part of its sum: a few
    coefficients that all patches share.
    """
    means = np.moveaxis(model.normalised.mean, -1, 0)
    common = means[1] if np.array_equal(means[1], means[2]) else np.zeros_like(means[1])
    return common, (means - common) / model.normalised.deviation


def _products(
    table: NDArray[np.floating], largest: float
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Columns (light, n) and (view, n) whose products' sum is a table (light, view), but for
    `_IMAGES_ERROR` of the value `largest`. n is 0 for a table of nothing."""
    left, singular, right = np.linalg.svd(table.astype(np.float64), full_matrices=False)
    allowed = table.size * (_IMAGES_ERROR * largest) ** 2
    left_out = np.cumsum(singular[::-1] ** 2)[::-1]  # from each one on
    count = int(np.sum(left_out > allowed))
    root = np.sqrt(singular[:count])
    return left[:, :count] * root, right[:count].T * root


def _part(
    model: SparseBtf,
    key: str,
    mean: tuple[NDArray[np.floating], NDArray[np.floating]],
    light_maps: Callable[[NDArray[np.floating]], Maps],
    view_maps: Callable[[NDArray[np.floating]], Maps],
) -> Part:
    """One channel: what is coded, after the products of its mean."""
    codes, (ys, xs, lights, views) = _channel(model, key)
    sizes = [own.shape[2] for own in (ys, xs, lights, views)]
    places = np.unravel_index(codes.positions, sizes)
    member = codes.members[None]
    numbers = (places[0] * sizes[1] + places[1], places[2], places[3])
    counts = (sizes[0] * sizes[1], sizes[2], sizes[3])
    used = [
        _Used.of(member * count + number, codes.values != 0, count)
        for number, count in zip(numbers, counts, strict=True)
    ]
    texels = [
        np.outer(ys[k][:, a // sizes[1]], xs[k][:, a % sizes[1]]).ravel() for k, a in used[0].atoms
    ]
    columns = [
        np.stack([own[k][:, a] for k, a in one.atoms], 1)
        for own, one in ((lights, used[1]), (views, used[2]))
    ]
    coefficients = np.empty((*codes.values.shape, 4), np.float32)
    coefficients[..., 0] = codes.values
    for column, one in enumerate(used, 1):
        coefficients[..., column] = one.rows
    count = mean[0].shape[1]
    if count:
        first = [len(texels), *(own.shape[1] for own in columns)]
        before = np.empty((count, coefficients.shape[1], 4), np.float32)
        before[:] = (1.0, *first)
        before[..., 2:] += np.arange(count)[:, None, None]
        texels.append(np.ones(len(texels[0])))
        columns = [np.hstack(both) for both in zip(columns, mean, strict=True)]
        coefficients = np.concatenate([before, coefficients])
    tall, wide = model.ensemble.patch
    across = -(-model.width // wide)
    return Part(
        coefficients=coefficients.reshape(len(coefficients), -1, across, 4),
        texels=np.array(texels, np.float32).reshape(-1, tall, wide),
        light=light_maps(columns[0]),
        view=view_maps(columns[1]),
    )


@dataclass(frozen=True)
class _Used:
    """The atoms of one mode that any coefficient uses."""

    atoms: list[tuple[int, int]]  # dictionary and column
    rows: NDArray[np.intp]  # of each coefficient: its atom's number

    @classmethod
    def of(cls, numbers: NDArray[np.integer], nonzero: NDArray[np.bool_], size: int) -> _Used:
        found = np.unique(numbers[nonzero]) if nonzero.any() else np.zeros(1, np.intp)
        rows = np.where(nonzero, np.searchsorted(found, numbers), 0)
        return cls([divmod(int(number), size) for number in found], rows)


def _channel(model: SparseBtf, key: str) -> tuple[Codes, tuple[NDArray[np.float32], ...]]:
    """The codes of one of Y, U, V, and the dictionaries y, x, light, view that they are in."""
    if key in model.codes:
        return model.codes[key], tuple(model.ensemble.dictionaries[key])
    # One part for all channels: its fifth mode gives each coefficient a share in each channel.
    codes = model.codes[CHANNELS]
    *matrices, colour = model.ensemble.dictionaries[CHANNELS]
    sizes = [own.shape[2] for own in matrices]
    positions, colours = np.divmod(codes.positions, colour.shape[2])
    assert positions.max(initial=0) < prod(sizes)
    share = colour[codes.members[None], CHANNELS.index(key), colours]
    return Codes(positions, codes.values * share, codes.members), tuple(matrices)


def _quads_of(maps: Maps) -> Maps:
    """(rows, N, N) as (quads, N, N, 4)."""
    return np.ascontiguousarray(np.moveaxis(quads(np.moveaxis(maps, 0, -1)), -2, 0))
