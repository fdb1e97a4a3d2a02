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
from .clustered_tucker import MODES, ClusteredTucker, modes_of
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
    sizes = mode_sizes(dataset)
    rank_light, clusters, mixtures, share = {
        "DRAFT": (12, 5, 2, 3 / 8),
        "MEDIUM": (20, 7, 3, 1 / 2),
        "HIGH": (32, 12, 3, 3 / 4),
    }[quality]
    if dataset.kind == "occlusion":  # less to hold, and a wrong texel is seen
        clusters *= 2

    def spatial(size: int) -> int:
        return min(size, max(4, 4 * round(size * share / 4)))

    ranks = {
        "light": min(rank_light, sizes.get("light", 0)),
        "view": min(4, sizes["view"]),
        "y": spatial(sizes["y"]),
        "x": spatial(sizes["x"]),
    }
    ranks = {mode: ranks[mode] for mode in sizes}
    if method == "nsvd":
        return {"ranks": {**ranks, "view": min(4 * clusters, sizes["view"])}}
    clusters = min(clusters, sizes["view"])
    mixtures = 1 if method == "cta" else min(mixtures, clusters)
    return {"ranks": ranks, "clusters": {"view": clusters}, "mixtures": {"view": mixtures}}


def compress(
    dataset: Dataset,
    method: str,
    *,
    ranks: Mapping[str, int],
    clusters: Mapping[str, int] | None = None,
    mixtures: Mapping[str, int] | None = None,
    global_modes: tuple[str, ...] | None = None,
    seed: int = 0,
    threads: int = 0,
    progress: Callable[[float, str], bool] | None = None,
) -> ClusteredTucker:
    """Fit a clustered Tucker model.

    method        "nsvd" (De Lathauwer et al. 2000), "cta" or "kcta" (Tsai and Shih 2012, Alg. 1)
    ranks         of every mode; the light mode's rows are colour times light
    clusters      of the clustered mode, {"view": C}; none for "nsvd"
    mixtures      of the clustered mode, {"view": K}; 1 for "cta"
    global_modes  whose basis all clusters share (Section 5.2); None: the light, which occlusion
                  lacks
    threads       0 for every core; the result does not depend on it

    Raises NacreError for settings that do not fit the dataset, Cancelled on request.
    """
    clusters, mixtures = dict(clusters or {}), dict(mixtures or {})
    modes = modes_of(dataset.kind)
    if global_modes is None:
        global_modes = tuple(mode for mode in ("light",) if mode in modes)
    _check(dataset, method, ranks, clusters, mixtures, global_modes)
    started = time.monotonic()
    # To the compiled helper, occlusion is a BTF of one light, of one basis row for all clusters.
    samples = dataset.samples if "light" in modes else dataset.samples[None, ..., None]
    order = tuple(ranks.get(mode, 1) for mode in MODES)
    shared = {*global_modes} | {*MODES} - {*modes}
    members: dict[str, NDArray[np.uint32]] = {}
    result: nacre_native.NsvdModel | nacre_native.KctaModel
    try:
        if method == "nsvd":
            result = nacre_native.fit_nsvd(samples, order, threads=threads, progress=progress)
        else:
            ((mode, count),) = clusters.items()
            result = nacre_native.fit_kcta(
                samples,
                order,
                clustered=MODES.index(mode),
                clusters=count,
                mixtures=mixtures.get(mode, 1),
                global_modes=tuple(MODES.index(name) for name in MODES if name in shared),
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
    core, bases = result["core"], dict(zip(MODES, result["basis"], strict=True))
    if "light" not in modes:
        core = core[:, 0] * bases.pop("light").item()  # 1 or -1
    model = ClusteredTucker(
        core=core,
        bases=bases,
        members=members,
        clusters=clusters,
        dataset=_describe(dataset),
        fit={
            "method": method,
            "seed": seed,
            "iterations": int(result["iterations"]),
            "errors": errors,
            "snr_db": round(-10.0 * log10(max(errors[-1], 1e-12)), 4),
            "seconds": round(time.monotonic() - started, 3),
        },
        kind=dataset.kind,
    )
    return round_model(model, errors[-1] * result["squared_norm"])


def mode_sizes(dataset: Dataset) -> dict[str, int]:
    """The rows of each mode; those of the light are colour times light."""
    sizes = {mode: dataset.sizes[mode] for mode in modes_of(dataset.kind)}
    if "channel" in dataset.sizes:
        sizes["light"] *= dataset.sizes["channel"]
    return sizes


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
    sizes = mode_sizes(dataset)
    for name, given in (("rank", ranks), ("clusters", clusters), ("mixtures", mixtures)):
        for mode, value in given.items():
            if mode not in sizes:
                raise NacreError(f"{name} of {mode!r}: the modes are {', '.join(sizes)}")
            if value < 1:
                raise NacreError(f"{name} {mode}={value}: expected 1 or more")
    for mode in sizes:
        if mode not in ranks:
            expected = ",".join(f"{name}=.." for name in sizes)
            raise NacreError(f"no rank for the mode {mode}: give --ranks {expected}")
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
    views = sizes["view"]
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
        if mode not in sizes or mode == "view":
            others = [name for name in sizes if name != "view"]
            expected = f"{', '.join(others[:-1])} or {others[-1]}"
            raise NacreError(f"global mode {mode!r}: expected {expected}")


def _describe(dataset: Dataset) -> dict[str, Any]:
    """What a model keeps of its dataset, JSON-able."""
    own: dict[str, Any] = {"view": dataset.view.tolist()}
    if dataset.kind == "btf":
        own = {"light": dataset.light.tolist(), **own, "channels": list(dataset.channels)}
    else:
        own["value"] = dataset.value
    return {
        **own,
        "patch_size": list(dataset.patch_size),
        "periodic": dataset.periodic,
        "noise_floor_db": dataset.noise_floor_db,
        "source": dataset.source,
    }
