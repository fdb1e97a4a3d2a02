"""Blends of sparse models of the same directions, texels and patches (SparseBTF, Section 3.5).

Mixed are the logarithms, Y, U and V of log(1 + RGB / offset), so that a blend is between its
materials as geometric means are: RGB + offset is the weighted geometric mean of theirs, in every
channel. With an offset far above the values that is nearly the mean of the values.

The paper's Eq. 7 mixes normalised coefficients and does not say what becomes of the means and
deviations of the images, which differ between materials. Here each sum of coefficients is taken
with its own,

    Z = sum over materials i of  w_i (S_i d_i + m_i),    S_i = coefficients x_n U^(n)

which is linear: it is what the same mix of the decoded logarithms is (`Blend`).

`bake` writes Z as the codes of one model. Z is normalised anew, by mean M and deviation D of each
image, and (Z - M) / D expressed in a dictionary U_k, for which the images of S_i are scaled by
g_i = w_i d_i / D. In Eq. 9, matrices R = U_k^T U_p of each mode take coefficients from a dictionary
p to k. Where deviations are alike, as where nothing is divided by any, and weights are numbers, g_i
is a number and the result that of Eqs. 8 and 9. The authors' deviations differ between images:
there, and in the spatial modes of a mask, g_i stands between U_k^T and U_p, and no R is formed. It
is exact all the same; what is lost is lost by keeping the largest coefficients only. Eq. 8 takes
the first material's dictionary: here a patch has the one, of all that the materials have, that
keeps most.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod
from typing import Any

import nacre_native
import numpy as np
from numpy.typing import NDArray

from ...errors import Cancelled, NacreError
from ..clustered_tucker import Part
from .coding import measure_against
from .ensemble import Ensemble
from .model import Codes, SparseBtf, quality_of, room_of, shares
from .patches import BLOCK, channels_of, indices_inside, tiling
from .transform import Normalisation, to_linear_rgb

_SUM = 1e-3  # by which weights may miss a sum of 1

Weight = float | NDArray[np.floating]
"""One number, or one for each texel (y, x)."""


@dataclass(frozen=True)
class Blend:
    """Sparse models and their weights (n, y, x), whose sum is 1; decoded as models are."""

    models: tuple[SparseBtf, ...]
    weights: NDArray[np.float32]

    @property
    def shape(self) -> tuple[int, ...]:
        """The decoded samples' shape (light, view, y, x, channel)."""
        return self.models[0].shape

    @property
    def offset(self) -> float:
        """Of the logarithm."""
        return self.models[0].normalised.offset

    def decode(
        self,
        light: Part = slice(None),
        view: Part = slice(None),
        y: Part = slice(None),
        x: Part = slice(None),
    ) -> NDArray[np.float32]:
        """Linear samples (light, view, y, x, channel) of one block, float32, unclamped."""
        mixed = sum(
            model.logarithms(light, view, y, x) * own[y][:, x][..., None]
            for model, own in zip(self.models, self.weights, strict=True)
        )
        return to_linear_rgb(np.asarray(mixed, np.float32), self.offset)

    def texel(self, light: int, view: int, y: int, x: int) -> NDArray[np.float32]:
        """The colour (3,) of one texel, from the coefficients of its patch in each model alone:
        what a shader that adds the sparse sums computes."""
        mixed = sum(
            model.texel_logarithm(light, view, y, x) * own[y, x]
            for model, own in zip(self.models, self.weights, strict=True)
        )
        return to_linear_rgb(np.asarray(mixed, np.float32), self.offset)


def blend(models: Sequence[SparseBtf], weights: Sequence[Weight]) -> Blend:
    """Mix models of the same directions, texels, patches and offset, of any dictionaries.

    weights  of each model, of sum 1 at every texel; below 0 and above 1 they go beyond the
             materials, as in cubic interpolation

    Raises NacreError, naming materials by their place from 1 on, when they do not go together.
    """
    first = models[0]
    for number, other in enumerate(models[1:], 2):
        reason = _misfit(first, other)
        if reason:
            raise NacreError(f"material {number} does not go with material 1: {reason}")
    given = np.empty((len(models), *first.shape[2:4]), np.float32)
    for number, weight in enumerate(weights):
        if np.ndim(weight) and np.shape(weight) != given.shape[1:]:
            height, width = np.shape(weight)
            raise NacreError(
                f"the mask has {width} x {height} texels and the materials have "
                f"{first.width} x {first.height}: give it the same"
            )
        given[number] = weight
    if not np.abs(given.sum(0) - 1.0).max() <= _SUM:
        raise NacreError("the weights of a blend must have a sum of 1")
    return Blend(tuple(models), given)


def bake(
    mix: Blend,
    sparsity: Mapping[str, int] | int | None = None,
    *,
    threads: int = 0,
    progress: Callable[[float, str], bool] | None = None,
) -> SparseBtf:
    """One model of a blend: Eqs. 8 and 9, and the largest `sparsity` coefficients of each patch; by
    default as many as the material has that has most. Of a quality, they are divided among the
    parts as those of all materials are.

    M is the sum of w_i m_i, with masks' means for weights, and D that of w_i d_i: the deviation
    that Z has at most, and has where materials go up and down together; 1 where nothing is divided.
    So a material alone comes back as it is. D decides only how images count among each other when
    coefficients are left out.

    `fit` says how much of the normalised logarithms' energy was left out (`lost`), and the SNR
    against the unbaked blend in linear values. Raises NacreError for a sparsity that is out of
    range, Cancelled on request.
    """
    started = time.monotonic()
    shares = [round(float(own.mean()), 6) for own in mix.weights]
    mix = _used(mix)
    first = mix.models[0]
    alike = [model for model in mix.models if _same_parts(model, first)]
    ensemble = _joined([model.ensemble for model in alike])
    if not isinstance(sparsity, Mapping):
        sparsity = _counts([model.sparsity for model in alike], sparsity, ensemble)
    for key, count in sparsity.items():
        most = prod(ensemble.shape(key))
        if not 1 <= count <= most:
            raise NacreError(f"sparsity {key}={count}: expected 1 to {most}")
    normalised = _normalisation(mix)
    total = len(first.codes[next(iter(first.codes))].members)
    codes = {
        key: Codes(
            np.zeros((count, total), np.uint32),
            np.zeros((count, total), np.float32),
            np.zeros(total, np.uint32),
        )
        for key, count in sparsity.items()
    }
    energy = lost = 0.0
    for part, patches in _patches(mix, normalised):
        if progress is not None and not progress(0.7 * part.start / total, "Blending patches"):
            raise Cancelled
        for key, own in codes.items():
            values = channels_of(patches, key)
            found = nacre_native.code_patches(
                values, ensemble.dictionaries[key], sparsity[key], threads=threads
            )
            own.positions[:, part] = found["positions"].T
            own.values[:, part] = found["values"].T
            own.members[part] = found["members"]
            energy += float(np.vdot(values, values))
            lost += float(found["errors"].sum())
    model = SparseBtf(
        height=first.height,
        width=first.width,
        ensemble=ensemble,
        normalised=normalised,
        codes={key: own.rounded() for key, own in codes.items()},
        dataset=_described(mix),
        quality=quality_of(sparsity, ensemble.patch),
    )

    def read(y: slice, x: slice) -> NDArray[np.float32]:
        return mix.decode(y=y, x=x)

    def later(fraction: float, message: str) -> bool:
        return progress is None or progress(0.7 + 0.3 * fraction, message)

    fit = {
        "method": "sparse",
        "weights": shares,
        "lost": round(lost / energy, 6) if energy else 0.0,
        "snr_db": round(measure_against(read, model, later)["snr_db"], 4),
        "seconds": round(time.monotonic() - started, 3),
    }
    return replace(model, fit=fit)


def _used(mix: Blend) -> Blend:
    """Without the materials that there is nothing of."""
    used = [number for number, weight in enumerate(mix.weights) if weight.any()]
    return Blend(tuple(mix.models[number] for number in used), mix.weights[used])


def _misfit(first: SparseBtf, other: SparseBtf) -> str:
    """Why two models cannot be mixed, or ""."""
    sizes = (
        ("texels", (first.width, first.height), (other.width, other.height)),
        ("a patch", first.ensemble.patch[::-1], other.ensemble.patch[::-1]),
    )
    for what, wanted, found in sizes:
        if wanted != found:
            return f"{what}: {found[0]} x {found[1]}, not {wanted[0]} x {wanted[1]}"
    reason = other.ensemble.misfit(first.ensemble)
    offset, own = first.normalised.offset, other.normalised.offset
    if not reason and own != offset:
        reason = f"its logarithm has the offset {own:g}, not {offset:g}"
    return reason


def _same_parts(model: SparseBtf, first: SparseBtf) -> bool:
    """Whether both code the same channels together: matrices of others have another shape."""
    return [*model.codes] == [*first.codes]


def _counts(
    sparsities: Sequence[Mapping[str, int]], quality: int | None, ensemble: Ensemble
) -> dict[str, int]:
    """The most coefficients of each part in several models; of a quality, in proportion to those of
    all together, which a blend has where patches are in the same dictionary."""
    if quality is None:
        return {key: max(own[key] for own in sparsities) for key in sparsities[0]}
    every = {key: sum(own[key] for own in sparsities) for key in sparsities[0]}
    room = room_of(quality, tuple(every), ensemble.patch)
    counts = shares(every, room / sum(every.values()))
    return {key: min(count, prod(ensemble.shape(key))) for key, count in counts.items()}


def _joined(ensembles: Sequence[Ensemble]) -> Ensemble:
    """One ensemble of all dictionaries that differ."""
    joined = ensembles[0]
    seen = [joined]
    for ensemble in ensembles[1:]:
        if any(_equal(ensemble, other) for other in seen):
            continue
        seen.append(ensemble)
        dictionaries = {
            key: tuple(
                np.concatenate(both) for both in zip(modes, ensemble.dictionaries[key], strict=True)
            )
            for key, modes in joined.dictionaries.items()
        }
        joined = replace(joined, dictionaries=dictionaries)
    return joined


def _equal(a: Ensemble, b: Ensemble) -> bool:
    return all(
        np.array_equal(one, other)
        for key, modes in a.dictionaries.items()
        for one, other in zip(modes, b.dictionaries[key], strict=True)
    )


def _normalisation(mix: Blend) -> Normalisation:
    """M and D of each image (see `bake`)."""
    share = mix.weights.mean((1, 2), dtype=np.float64)
    means, deviations = (
        np.array([getattr(model.normalised, name) for model in mix.models], np.float64)
        for name in ("mean", "deviation")
    )
    return Normalisation(
        np.tensordot(share, means, 1).astype(np.float32),
        # Weights below 0 turn an image over: its deviation counts all the same.
        np.tensordot(np.abs(share), deviations, 1).astype(np.float32),
        mix.offset,
    )


def _patches(mix: Blend, normalised: Normalisation) -> Iterator[tuple[slice, NDArray[np.float32]]]:
    """Patches (n, y, x, light, view, 3) of (Z - M) / D, as `read_patches` gives those of a dataset;
    of what is over the edge, too, each model has its own."""
    first = mix.models[0]
    tall, wide = first.ensemble.patch
    origins = tiling(first.height, first.width, (tall, wide))
    scales = [model.normalised.deviation / normalised.deviation for model in mix.models]
    by_image = normalised.deviation[..., None]
    means = [model.normalised.mean / by_image for model in mix.models]
    mean = normalised.mean / by_image
    most = max(1, BLOCK // (tall * wide * mean.size))
    for begin in range(0, len(origins), most):
        part = slice(begin, min(begin + most, len(origins)))
        found = np.empty((part.stop - begin, tall, wide, *mean.shape), np.float32)
        found[...] = -mean
        for patch, (index, (y, x)) in zip(found, enumerate(origins[part], begin), strict=True):
            rows = indices_inside(y, tall, first.height, first.dataset["periodic"])
            columns = indices_inside(x, wide, first.width, first.dataset["periodic"])
            for model, own, scale, level in zip(
                mix.models, mix.weights, scales, means, strict=True
            ):
                values = model.normalised_patch(index)
                values *= scale[..., None]
                values += level
                values *= own[rows][:, columns][..., None, None, None]
                patch += values
        yield part, found


def _described(mix: Blend) -> dict[str, Any]:
    """What is said of the blend's samples."""
    datasets = [model.dataset for model in mix.models]
    return {
        **datasets[0],
        "periodic": all(dataset["periodic"] for dataset in datasets),
        "noise_floor_db": None,
        "source": {
            "format": "blend",
            "file": "",
            "conversions": [],
            "materials": [dataset["source"] for dataset in datasets],
        },
    }
