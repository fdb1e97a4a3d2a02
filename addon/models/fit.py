"""Fit a model to a dataset: N-SVD, CTA, K-CTA or MK-CTA by the compiled helper."""

from __future__ import annotations

import time
from collections.abc import Callable, Container, Iterable, Mapping
from dataclasses import replace
from math import log10
from pathlib import Path
from typing import Any

import nacre_native
import numpy as np
from numpy.typing import NDArray

from ..datasets.dataset import Dataset
from ..errors import Cancelled, NacreError
from .checkpoint import Checkpoint
from .clustered_tucker import MODES, ClusteredTucker, modes_of
from .coarse import coarse_start
from .domain import check_domain
from .precision import round_model
from .snr import measure_snr

METHODS = ("nsvd", "cta", "kcta", "mkcta")
SEARCHES = ("auto", "kcta", "greedy", "optimal")
QUALITIES = ("DRAFT", "MEDIUM", "HIGH")
QUALITY = "HIGH"
"""The usual one: about as close to the real thing as the samples themselves (docs/truth.md)."""


_MOST_VIEWS = 12  # clusters of views where lights are clustered, too


def quality_settings(
    dataset: Dataset, method: str, quality: str = QUALITY
) -> dict[str, dict[str, int]]:
    """Ranks, clusters and mixtures for a quality, as keyword arguments of `compress`.

    Ranks are multiples of 4 and R_view = 4 a cluster, as K-CTA Section 6 advises, so that the
    methods have about the same size at one quality.
    """
    sizes = mode_sizes(dataset)
    rank_light, clusters, mixtures, share = {
        "DRAFT": (12, 5, 2, 3 / 8),
        "MEDIUM": (20, 7, 3, 1 / 2),
        "HIGH": (56, 20, 3, 5 / 8),
    }[quality]
    if dataset.kind == "occlusion":  # less to hold, and a wrong texel is seen
        clusters *= 2

    def spatial(size: int) -> int:
        return min(size, max(4, 4 * round(size * share / 4)))

    ranks = {
        "light": min(rank_light, sizes.get("light", 1)),
        "view": min(4, sizes["view"]),
        "y": spatial(sizes["y"]),
        "x": spatial(sizes["x"]),
    }
    ranks = {mode: ranks[mode] for mode in sizes}
    if method == "nsvd":
        return {"ranks": {**ranks, "view": min(4 * clusters, sizes["view"])}}
    counts = {"view": min(clusters, sizes["view"])}
    if method == "mkcta" and "light" in sizes:  # C_n R_n as N-SVD's rank (MK-CTA, Section 4.3)
        counts = {
            "light": min(rank_light // 4, dataset.sizes["light"]),
            # Every cluster of views has a core with each of lights.
            "view": min(_MOST_VIEWS, counts["view"]),
        }
        ranks["light"] = min(4, sizes["light"])
    if method == "cta":
        mixtures = 1
    return {
        "ranks": ranks,
        "clusters": counts,
        "mixtures": {mode: min(mixtures, count) for mode, count in counts.items()},
    }


def compress(
    dataset: Dataset,
    method: str,
    *,
    ranks: Mapping[str, int],
    clusters: Mapping[str, int] | None = None,
    mixtures: Mapping[str, int] | None = None,
    global_modes: tuple[str, ...] | None = None,
    search: str = "auto",
    coarse: int = 1,
    domain: str = "linear",
    seed: int = 0,
    threads: int = 0,
    memory: int = 0,
    state: Path | None = None,
    resume: bool = False,
    start: tuple[ClusteredTucker, float] | None = None,
    iterations: int | None = None,
    progress: Callable[[float, str], bool] | None = None,
) -> ClusteredTucker:
    """Fit a clustered Tucker model.

    method        "nsvd" (De Lathauwer et al. 2000), "cta" or "kcta" (Tsai and Shih 2012, Alg. 1),
                  "mkcta" (Tsai 2015, Alg. 1)
    ranks         of every mode; the light mode's rows are colour times light
    clusters      of the clustered modes, {"view": C}: one for "cta" and "kcta", any for "mkcta",
                  none for "nsvd". The colours of a light share its clusters
    mixtures      of the clustered modes, {"view": K}; 1 where not given
    global_modes  whose basis all clusters share (Section 5.2); None: the light for "cta" and
                  "kcta", y and x for "mkcta", as far as they are there and not clustered
    search        "kcta" (Theorems 1 and 3), "greedy" (orthogonal least squares; MK-CTA, Alg. 3),
                  "optimal" (MK-CTA, Alg. 2); "auto": "kcta" for one clustered mode, else "optimal"
                  for K < 3 and "greedy" beyond
    coarse        begin with a fit of texels averaged over this many along y and x, where these are
                  not global (MK-CTA, Section 5.2)
    domain        "linear", or "log" to fit log luminance with chroma (models.domain), for an error
                  that looks the same in the dark as in the light; `fit["errors"]` are of the
                  domain, `fit["snr_db"]` of linear values
    threads       0 for every core; the result does not depend on it
    memory        bytes of anonymous memory that the process may take; 0 for no bound. What does not
                  fit goes to files beside `state`
    state         where a long fit keeps its state after each iteration, removed when it ends;
                  None for nowhere
    resume        begin from `state`, if it is there: a fit that was killed ends with the same
                  result as one that was not
    start         a model of these settings to begin from, but by "nsvd", and sum A^2 of the samples
    iterations    at most; None: until the error stands still

    Raises NacreError for settings that do not fit the dataset, Cancelled on request.
    """
    clusters, mixtures = dict(clusters or {}), dict(mixtures or {})
    clusters = {mode: clusters[mode] for mode in MODES if mode in clusters} | clusters
    modes = modes_of(dataset.kind)
    if global_modes is None:
        global_modes = usual_global_modes(method, modes, clusters)
    _check(dataset, method, ranks, clusters, mixtures, global_modes, search)
    check_domain(domain, dataset)
    started = time.monotonic()
    # To the compiled helper, occlusion is a BTF of one light, whose basis is one number for all.
    missing = tuple(mode for mode in MODES if mode not in modes)
    samples = dataset.samples[None, ..., None] if missing else dataset.samples
    order = tuple(ranks.get(mode, 1) for mode in MODES)
    settings = {
        "method": method,
        "value": dataset.value,
        "ranks": {mode: ranks[mode] for mode in modes},
        "clusters": clusters,
        "mixtures": {mode: mixtures.get(mode, 1) for mode in clusters},
        "global_modes": list(global_modes),
        "search": search,
        "coarse": coarse,
        "domain": domain,
        "seed": seed,
    }
    checkpoint = Checkpoint(state, settings, dataset) if state else None
    shared: dict[str, Any] = {
        "threads": threads,
        "memory": memory,
        "scratch": str(state.parent) if state else "",
        "start": checkpoint.load() if checkpoint and resume else None,
        "checkpoint": checkpoint.save if checkpoint else None,
        "progress": progress,
    }
    if iterations is not None:
        shared["iterations"] = iterations
    result: dict[str, Any]
    try:
        if method == "nsvd":
            result = {**nacre_native.fit_nsvd(samples, order, domain=domain, **shared)}
        else:
            clustering: dict[str, Any] = {
                "clusters": {MODES.index(mode): count for mode, count in clusters.items()},
                "mixtures": {MODES.index(mode): count for mode, count in mixtures.items()},
                "global_modes": tuple(MODES.index(mode) for mode in (*missing, *global_modes)),
                "directions": {MODES.index(mode): _places(dataset, mode) for mode in clusters},
                "search": search,
                "domain": domain,
                "tolerance": 5e-4 if len(clusters) == 1 else 2e-3,
                "seed": seed,
            }
            if start is not None:
                shared["start"] = _started(*start)
            elif coarse > 1 and shared["start"] is None:
                shared["start"] = coarse_start(
                    samples,
                    order,
                    coarse,
                    folder=shared["scratch"] or None,
                    threads=threads,
                    memory=memory,
                    progress=progress,
                    **clustering,
                )
            result = {**nacre_native.fit_clustered(samples, order, **clustering, **shared)}
    except nacre_native.Cancelled as error:
        if checkpoint and not resume:
            checkpoint.remove()
        raise Cancelled from error
    except (ValueError, MemoryError) as error:
        raise NacreError(f"{dataset.path.name}: {error}") from error
    except OSError as error:
        raise NacreError(f"{dataset.path.name}: {error}") from error
    if checkpoint:
        checkpoint.remove()
    errors = [float(error) for error in result["errors"]]
    members = {MODES[mode]: rows for mode, rows in result.get("members", {}).items()}
    core, bases = result["core"], dict(zip(MODES, result["basis"], strict=True))
    if missing:
        core = core[:, 0] * bases.pop("light").item()  # 1 or -1
    model = ClusteredTucker(
        core=core,
        bases=bases,
        members=members,
        clusters=clusters,
        dataset=describe(dataset),
        fit={
            "method": method,
            "search": search,
            **({"domain": domain} if dataset.kind == "btf" else {}),
            "seed": seed,
            "iterations": int(result["iterations"]),
            "passes": int(result["passes"]),
            "errors": errors,
            "snr_db": round(-10.0 * log10(max(errors[-1], 1e-12)), 4),
            "seconds": round(time.monotonic() - started, 3),
        },
        kind=dataset.kind,
    )
    model = round_model(model, errors[-1] * result["squared_norm"])
    if domain == "linear":
        return model
    snr_db = round(measure_snr(dataset, model, progress), 4)
    return replace(model, fit={**model.fit, "snr_db": snr_db})


def _started(model: ClusteredTucker, squared_norm: float) -> dict[str, Any]:
    """A model in the layout of the compiled helper."""
    return {
        "core": model.core,
        "basis": [model.bases[mode] for mode in model.modes],
        "members": {MODES.index(mode): rows for mode, rows in model.members.items()},
        "errors": [],
        "squared_norm": squared_norm,
    }


def usual_global_modes(
    method: str, modes: Iterable[str], clusters: Container[str]
) -> tuple[str, ...]:
    """The modes whose basis all clusters share, unless told otherwise."""
    usual = {"nsvd": (), "mkcta": ("y", "x")}.get(method, ("light",))
    return tuple(mode for mode in usual if mode in modes and mode not in clusters)


def mode_sizes(dataset: Dataset) -> dict[str, int]:
    """The rows of each mode; those of the light are colour times light."""
    sizes = {mode: dataset.sizes[mode] for mode in modes_of(dataset.kind)}
    if "light" in sizes:
        sizes["light"] *= dataset.sizes["channel"]
    return sizes


def _places(dataset: Dataset, mode: str) -> NDArray[np.float64]:
    """Where the items of a mode lie, for the first clusters (K-CTA, Section 5.1): (items, any)."""
    if mode in ("light", "view"):
        return np.asarray(getattr(dataset, mode), np.float64)
    return np.arange(dataset.shape[dataset.axes.index(mode)], dtype=np.float64)[:, None]


def _check(
    dataset: Dataset,
    method: str,
    ranks: Mapping[str, int],
    clusters: Mapping[str, int],
    mixtures: Mapping[str, int],
    global_modes: tuple[str, ...],
    search: str,
) -> None:
    """Raise NacreError, in the user's own words, for settings that cannot be fitted."""
    if method not in METHODS:
        raise NacreError(f"method {method!r}: expected one of {', '.join(METHODS)}")
    if search not in SEARCHES:
        raise NacreError(f"search {search!r}: expected one of {', '.join(SEARCHES)}")
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
            raise NacreError("nsvd has no clusters or mixtures: use cta, kcta or mkcta")
        return
    if method == "mkcta" and not clusters:
        raise NacreError("mkcta clusters one or more modes: give --clusters light=C,view=C")
    if method != "mkcta" and len(clusters) != 1:
        raise NacreError(f"{method} clusters one mode: give --clusters view=C, or use mkcta")
    for mode, count in clusters.items():
        items = dataset.sizes[mode]  # not the rows: a light's colours share its clusters
        if count > items:
            raise NacreError(f"clusters {mode}={count} is more than the {items} of that mode")
        mixture = mixtures.get(mode, 1)
        if mixture > count:
            raise NacreError(f"mixtures {mode}={mixture} is more than clusters {mode}={count}")
        if method == "cta" and mixture != 1:
            raise NacreError(f"cta has one mixture cluster, not {mixture}: use kcta")
    unclustered = set(mixtures) - set(clusters)
    if unclustered:
        raise NacreError(f"mixtures of {min(unclustered)}: only clustered modes have them")
    for mode in global_modes:
        if mode not in sizes or mode in clusters:
            others = [name for name in sizes if name not in clusters]
            raise NacreError(f"global mode {mode!r}: expected {' or '.join(others)}")


def describe(dataset: Dataset) -> dict[str, Any]:
    """What a model keeps of its dataset, JSON-able."""
    own: dict[str, Any] = {"value": dataset.value}
    if dataset.kind == "btf":
        own = {"light": dataset.light.tolist(), "channels": list(dataset.channels)}
    return {
        **own,
        "view": dataset.view.tolist(),
        "patch_size": list(dataset.patch_size),
        "periodic": dataset.periodic,
        "noise_floor_db": dataset.noise_floor_db,
        "source": dataset.source,
    }
