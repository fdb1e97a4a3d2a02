"""Fit a model to a dataset: N-SVD, CTA or K-CTA by the compiled helper."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from math import log10
from typing import Any

import nacre_native
import numpy as np
from numpy.typing import NDArray

from ..datasets.dataset import Dataset
from ..errors import Cancelled, NacreError
from .clustered_tucker import MODES, ClusteredTucker
from .precision import round_model

METHODS = ("nsvd", "cta", "kcta")
QUALITIES = ("DRAFT", "MEDIUM", "HIGH")


def quality_settings(
    dataset: Dataset, method: str, quality: str = "MEDIUM"
) -> dict[str, dict[str, int]]:
    """Ranks, clusters and mixtures for a quality, as keyword arguments of `compress`.

    Ranks are multiples of 4 and R_view = 4 a cluster, as K-CTA Section 6 advises, so that the
    methods have about the same size at one quality.
    """
    lights, views, height, width, channels = dataset.shape
    rank_light, clusters, mixtures, share = {
        "DRAFT": (12, 5, 2, 3 / 8),
        "MEDIUM": (20, 7, 3, 1 / 2),
        "HIGH": (32, 12, 3, 3 / 4),
    }[quality]

    def spatial(size: int) -> int:
        return min(size, max(4, 4 * round(size * share / 4)))

    ranks = {
        "light": min(rank_light, channels * lights),
        "view": min(4, views),
        "y": spatial(height),
        "x": spatial(width),
    }
    if method == "nsvd":
        return {"ranks": {**ranks, "view": min(4 * clusters, views)}}
    clusters = min(clusters, views)
    mixtures = 1 if method == "cta" else min(mixtures, clusters)
    return {"ranks": ranks, "clusters": {"view": clusters}, "mixtures": {"view": mixtures}}


def compress(
    dataset: Dataset,
    method: str,
    *,
    ranks: Mapping[str, int],
    clusters: Mapping[str, int] | None = None,
    mixtures: Mapping[str, int] | None = None,
    global_modes: tuple[str, ...] = ("light",),
    seed: int = 0,
    threads: int = 0,
    progress: Callable[[float, str], bool] | None = None,
) -> ClusteredTucker:
    """Fit a clustered Tucker model.

    method        "nsvd" (De Lathauwer et al. 2000), "cta" or "kcta" (Tsai and Shih 2012, Alg. 1)
    ranks         of the four modes; the light mode's rows are colour times light
    clusters      of the clustered mode, {"view": C}; none for "nsvd"
    mixtures      of the clustered mode, {"view": K}; 1 for "cta"
    global_modes  whose basis all clusters share (Section 5.2)
    threads       0 for every core; the result does not depend on it

    Raises NacreError for settings that do not fit the dataset, Cancelled on request.
    """
    clusters, mixtures = dict(clusters or {}), dict(mixtures or {})
    _check(dataset, method, ranks, clusters, mixtures, global_modes)
    started = time.monotonic()
    order = tuple(ranks[mode] for mode in MODES)
    members: dict[str, NDArray[np.uint32]] = {}
    result: nacre_native.NsvdModel | nacre_native.KctaModel
    try:
        if method == "nsvd":
            result = nacre_native.fit_nsvd(
                dataset.samples, order, threads=threads, progress=progress
            )
        else:
            ((mode, count),) = clusters.items()
            result = nacre_native.fit_kcta(
                dataset.samples,
                order,
                clustered=MODES.index(mode),
                clusters=count,
                mixtures=mixtures.get(mode, 1),
                global_modes=tuple(MODES.index(name) for name in global_modes),
                directions=dataset.view,
                seed=seed,
                threads=threads,
                progress=progress,
            )
            members[mode] = result["members"]
    except nacre_native.Cancelled as error:
        raise Cancelled from error
    except ValueError as error:
        raise NacreError(f"{dataset.path.name}: {error}") from error
    errors = [float(error) for error in result["errors"]]
    model = ClusteredTucker(
        core=result["core"],
        bases=dict(zip(MODES, result["basis"], strict=True)),
        members=members,
        clusters=clusters,
        dataset=describe(dataset),
        fit={
            "method": method,
            "seed": seed,
            "iterations": int(result["iterations"]),
            "errors": errors,
            "snr_db": round(-10.0 * log10(max(errors[-1], 1e-12)), 4),
            "seconds": round(time.monotonic() - started, 3),
        },
    )
    return round_model(model, errors[-1] * result["squared_norm"])


def _check(
    dataset: Dataset,
    method: str,
    ranks: Mapping[str, int],
    clusters: Mapping[str, int],
    mixtures: Mapping[str, int],
    global_modes: tuple[str, ...],
) -> None:
    """Raise NacreError, in the user's own words, for settings that cannot be fitted."""
    if method not in METHODS:
        raise NacreError(f"method {method!r}: expected one of {', '.join(METHODS)}")
    for name, given in (("rank", ranks), ("clusters", clusters), ("mixtures", mixtures)):
        for mode, value in given.items():
            if mode not in MODES:
                raise NacreError(f"{name} of {mode!r}: the modes are {', '.join(MODES)}")
            if value < 1:
                raise NacreError(f"{name} {mode}={value}: expected 1 or more")
    lights, views, height, width, channels = dataset.shape
    sizes = dict(zip(MODES, (channels * lights, views, height, width), strict=True))
    for mode in MODES:
        if mode not in ranks:
            raise NacreError(
                f"no rank for the mode {mode}: give --ranks light=..,view=..,y=..,x=.."
            )
        if ranks[mode] > sizes[mode]:
            raise NacreError(
                f"rank {mode}={ranks[mode]} is larger than the mode, which has {sizes[mode]} rows"
            )
    if method == "nsvd":
        if clusters or mixtures:
            raise NacreError("nsvd has no clusters or mixtures: use cta or kcta")
        return
    if list(clusters) != ["view"]:
        raise NacreError(f"{method} clusters the view mode: give --clusters view=C")
    if clusters["view"] > views:
        raise NacreError(f"clusters view={clusters['view']} is more than the {views} views")
    mixture = mixtures.get("view", 1)
    if mixture > clusters["view"]:
        raise NacreError(f"mixtures view={mixture} is more than clusters view={clusters['view']}")
    if set(mixtures) - {"view"}:
        raise NacreError("mixtures: only the clustered mode, view, has them")
    if method == "cta" and mixture != 1:
        raise NacreError(f"cta has one mixture cluster, not {mixture}: use kcta")
    for mode in global_modes:
        if mode not in MODES or mode == "view":
            raise NacreError(f"global mode {mode!r}: expected light, y or x")


def describe(dataset: Dataset) -> dict[str, Any]:
    """What a model keeps of its dataset, JSON-able."""
    return {
        "light": dataset.light.tolist(),
        "view": dataset.view.tolist(),
        "channels": list(dataset.channels),
        "patch_size": list(dataset.patch_size),
        "periodic": dataset.periodic,
        "noise_floor_db": dataset.noise_floor_db,
        "source": dataset.source,
    }
