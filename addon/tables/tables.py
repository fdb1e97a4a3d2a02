"""Tables of a clustered Tucker model: BTFs of any of the tensor methods, and occlusion.

A value is, at the texel (y, x), for a light and a view direction,

    sum over k_l, k_v, r_l, r_v of  light[o(view_index[k_v]), channel, k_l, r_l]
                                  * view[o(light_index[k_l]), k_v, r_v]
                                  * core[light_index[k_l], view_index[k_v], r_l, r_v, y, x]

with light, view and indices read from the parabolic texel nearest to each direction (K-CTA, Section
6.3.3; MK-CTA, Section 5.1). o(c) is c where rows differ from cluster to cluster of the other mode,
and 0 where one set of rows serves all. Ranks of the view and of the light are stored as quads, four
to an RGBA texel, filled up with zeros. No light enters occlusion: its one number is the value.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled, NacreError
from ..models.clustered_tucker import ClusteredTucker, expand
from ..models.interpolation import horizon_fade
from ..models.resample import Angular, resample_mode
from .parabolic import texel_directions

SIZE = 256
"""Texels along a parabolic map, as the paper uses."""

_CHUNK = 8192  # directions resampled at a time, to bound the memory of the cluster search


@dataclass(frozen=True)
class Tables:
    """What an evaluator reads of one model; all float32 but the indices. In C order nothing is
    copied to evaluate them on the CPU.

    core         (C_light, C_view, R_light, view quads, Y, X, 4): x and y modes expanded
    light        (owners, channels, K_light, light quads, N, N, 4): light basis, row = y of the
                 parabolic map, faded to 0 at the horizon; owners C_view or 1; None for occlusion
    view         (owners, K_view, view quads, N, N, 4): mixing coefficients; owners C_light or 1
    light_index  (K_light, N, N) uint32: the clusters of each light direction
    view_index   (K_view, N, N) uint32: the clusters of each view direction
    """

    core: NDArray[np.float32]
    light: NDArray[np.float32] | None
    view: NDArray[np.float32]
    light_index: NDArray[np.uint32]
    view_index: NDArray[np.uint32]

    @property
    def size(self) -> int:
        """Texels along a parabolic map."""
        return self.view_index.shape[-1]

    @property
    def height(self) -> int:
        """Texels along the patch's y."""
        return self.core.shape[4]

    @property
    def width(self) -> int:
        """Texels along the patch's x."""
        return self.core.shape[5]

    @property
    def channels(self) -> int:
        """Numbers in a value."""
        return 1 if self.light is None else self.light.shape[1]

    @property
    def reduced_once(self) -> bool:
        """Whether the core contracted with the view serves all lights."""
        return len(self.core) == 1

    @property
    def fetches(self) -> dict[str, int]:
        """RGBA texels read for one light at one spatial tap."""
        owners, mixtures, view_quads = self.view.shape[:3]
        lights = len(self.light_index)
        light = 0
        if self.light is not None:
            light_owners, channels, _, light_quads = self.light.shape[:4]
            light = channels * lights * light_quads * (mixtures if light_owners > 1 else 1)
        return {
            "core": lights * mixtures * self.core.shape[2] * view_quads,
            "view": mixtures * view_quads * (lights if owners > 1 else 1),
            "index": sum(count > 1 for count in self.core.shape[:2]),
            "light": light,
        }


def build_tables(
    model: ClusteredTucker,
    size: int = SIZE,
    progress: Callable[[float, str], bool] | None = None,
) -> Tables:
    """Resample a model's directions to parabolic maps of `size` and expand its core.

    Each map texel has the rows and clusters of its direction (models.resample).
    Raises NacreError when a spatial mode is clustered, and when colours were fitted as logarithms;
    Cancelled on request.
    """
    spatial = [mode for mode in model.clusters if mode in ("y", "x")]
    if spatial:
        raise NacreError(
            f"a model clustered in {' and '.join(spatial)} cannot be shown: compress with clusters "
            "of lights or views (kcta, mkcta)"
        )
    if model.domain != "linear":
        raise NacreError(
            f"a model fitted in the {model.domain} domain cannot be shown yet: compress with "
            "--domain linear"
        )

    def step(fraction: float, message: str) -> None:
        if progress is not None and not progress(fraction, message):
            raise Cancelled

    directions = texel_directions(size).reshape(-1, 3)

    def maps(mode: Angular, start: float, share: float) -> tuple[NDArray, NDArray[np.uint32]]:
        """Rows (owners, tied, K, quads, N, N, 4) and clusters (K, N, N) of a map's texels."""
        bases, members = [], []
        for first in range(0, len(directions), _CHUNK):
            step(start + share * first / len(directions), f"Resampling {mode}s")
            rows = resample_mode(model, mode, directions[first : first + _CHUNK])
            count = len(directions[first : first + _CHUNK])
            owners, tied, mixtures, _ = rows.basis.shape
            bases.append(
                rows.basis.astype(np.float32).reshape(owners, count, -1, mixtures, rank(mode))
            )
            members.append(
                np.zeros((count, mixtures), np.uint32) if rows.members is None else rows.members
            )
        basis = np.concatenate(bases, 1).transpose(0, 2, 3, 1, 4)
        basis = quads(basis.reshape(*basis.shape[:3], size, size, -1))
        return np.moveaxis(basis, -2, 3), np.concatenate(members).T.reshape(-1, size, size)

    def rank(mode: str) -> int:
        return model.ranks[mode]

    light, light_index = None, np.zeros((1, size, size), np.uint32)
    if model.kind == "btf":
        light, light_index = maps("light", 0.0, 0.35)
        fade = horizon_fade(np.asarray(model.dataset["light"], float), directions)
        light *= fade.reshape(size, size, 1).astype(np.float32)
    view, view_index = maps("view", 0.35, 0.35)

    step(0.7, "Expanding the core")
    core = np.stack([_expand_texels(model, cluster) for cluster in range(len(model.core))])
    counts = [model.clusters.get(mode, 1) for mode in ("light", "view")]
    core = np.moveaxis(quads(np.moveaxis(core, 2, -1)), -2, 2)
    step(1.0, "Tables ready")
    return Tables(
        core=np.ascontiguousarray(core).reshape(*counts, *core.shape[1:]),
        light=None if light is None else np.ascontiguousarray(light),
        view=np.ascontiguousarray(view[:, 0]),
        light_index=np.ascontiguousarray(light_index),
        view_index=np.ascontiguousarray(view_index),
    )


def _expand_texels(model: ClusteredTucker, cluster: int) -> NDArray[np.float32]:
    """A cluster's core with its y and x modes expanded: (R_light, R_view, Y, X)."""
    core = model.core[cluster]
    identities = [np.eye(rank, dtype=np.float32) for rank in core.shape[:-2]]
    spatial = [model.bases[mode][cluster % len(model.bases[mode]), :, 0] for mode in ("y", "x")]
    texels = expand(core, [*identities, *spatial])
    return texels if model.kind == "btf" else texels[None]


def quads(array: NDArray[np.floating]) -> NDArray[np.float32]:
    """The last axis in groups of four, filled up with zeros: (..., R) -> (..., R/4, 4)."""
    missing = -array.shape[-1] % 4
    filled = np.pad(array, [(0, 0)] * (array.ndim - 1) + [(0, missing)])
    return filled.reshape(*array.shape[:-1], -1, 4).astype(np.float32)
