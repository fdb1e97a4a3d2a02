"""Tables of a clustered Tucker model whose view mode may be clustered (N-SVD, CTA, K-CTA).

Each value is, at the texel (y, x), for a light and a view direction,

    sum over k, r_l, r_v of  light[channel, r_l] * view[k, r_v] * core[index[k], r_l, r_v, y, x]

with light, view and index read from the parabolic texel nearest to the direction (Section 6.3.3).
Ranks of the view and of the light are stored as quads, four to an RGBA texel, filled up with zeros.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled, NacreError
from ..models.clustered_tucker import ClusteredTucker, expand
from ..models.interpolation import horizon_fade
from ..models.resample import resample_mode
from .parabolic import texel_directions

SIZE = 256
"""Texels along a parabolic map, as the paper uses."""


@dataclass(frozen=True)
class Tables:
    """What an evaluator reads of one model; all float32 but the index.

    core   (clusters, R_light, view quads, Y, X, 4): x and y modes expanded
    view   (mixtures, view quads, N, N, 4): mixing coefficients, row = y of the parabolic map
    index  (mixtures, N, N) uint32: the cluster of each of a view's mixtures
    light  (channels, light quads, N, N, 4): light basis, faded to 0 at the horizon
    """

    core: NDArray[np.float32]
    view: NDArray[np.float32]
    index: NDArray[np.uint32]
    light: NDArray[np.float32]

    @property
    def size(self) -> int:
        """Texels along a parabolic map."""
        return self.index.shape[-1]

    @property
    def fetches(self) -> dict[str, int]:
        """RGBA texels read for one light at one spatial tap."""
        mixtures, view_quads = self.view.shape[:2]
        channels, light_quads = self.light.shape[:2]
        return {
            "core": mixtures * self.core.shape[1] * view_quads,
            "view": mixtures * view_quads,
            "index": -(-mixtures // 2),
            "light": channels * light_quads,
        }


def build_tables(
    model: ClusteredTucker,
    size: int = SIZE,
    progress: Callable[[float, str], bool] | None = None,
) -> Tables:
    """Resample a model's directions to parabolic maps of `size` and expand its core.

    Each map texel has the rows and clusters of its direction (models.resample).
    Raises NacreError for occlusion, when the light mode or a spatial mode is clustered, and when
    colours were fitted as logarithms; Cancelled on request.
    """
    if model.kind != "btf":
        raise NacreError(f"a model of {model.kind} cannot be shown yet: choose one of a BTF")
    if set(model.clusters) - {"view"}:
        raise NacreError(
            f"a model clustered in {' and '.join(model.clusters)} cannot be shown yet: compress "
            "with a method that clusters only the view (kcta)"
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
    step(0.0, "Resampling lights")
    light = resample_mode(model, "light", directions).basis.reshape(size, size, model.channels, -1)
    fade = horizon_fade(np.asarray(model.dataset["light"], float), directions)
    light = (light * fade.reshape(size, size, 1, 1)).transpose(2, 0, 1, 3)

    step(0.2, "Resampling views")
    rows = resample_mode(model, "view", directions)
    view = rows.basis.reshape(size, size, *rows.basis.shape[2:]).transpose(2, 0, 1, 3)
    index = np.zeros((len(view), size, size), np.uint32)
    if rows.members is not None:
        index = rows.members.reshape(size, size, -1).transpose(2, 0, 1)

    step(0.7, "Expanding the core")
    core = np.stack([_expand_texels(model, cluster) for cluster in range(len(model.core))])
    step(1.0, "Tables ready")
    return Tables(
        core=np.moveaxis(_quads(np.moveaxis(core, 2, -1)), -2, 2),
        view=np.moveaxis(_quads(view), -2, 1),
        index=index,
        light=np.moveaxis(_quads(light), -2, 1),
    )


def _expand_texels(model: ClusteredTucker, cluster: int) -> NDArray[np.float32]:
    """A cluster's core with its y and x modes expanded: (R_light, R_view, Y, X)."""
    core = model.core[cluster]
    identities = [np.eye(rank, dtype=np.float32) for rank in core.shape[:2]]
    spatial = [model.bases[mode][cluster % len(model.bases[mode]), :, 0] for mode in ("y", "x")]
    return expand(core, [*identities, *spatial])


def _quads(array: NDArray[np.floating]) -> NDArray[np.float32]:
    """The last axis in groups of four, filled up with zeros: (..., R) -> (..., R/4, 4)."""
    missing = -array.shape[-1] % 4
    filled = np.pad(array, [(0, 0)] * (array.ndim - 1) + [(0, missing)])
    return filled.reshape(*array.shape[:-1], -1, 4).astype(np.float32)
