"""Fit a model to a dataset."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import NacreError
from .arguments import Progress, above_0, counts, from_0, from_1, gigabytes, sparsity_parts

if TYPE_CHECKING:
    from ..datasets.dataset import Dataset
    from ..models.clustered_tucker import ClusteredTucker

ENCODINGS = {"distance": "signed-distance", "mask": "mask"}
WEIGHTS = ("lightness", "equal")
_BY_HAND = ("quality", "ranks", "clusters", "mixtures", "weights", "resume")
_SPARSE_QUALITY = 64


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", type=Path)
    parser.add_argument("model", type=Path)
    parser.add_argument(
        "--method", default="kcta", help="nsvd, cta, kcta (default), mkcta or sparse"
    )
    target = parser.add_mutually_exclusive_group()
    target.add_argument(
        "--target-db", type=above_0, metavar="DB", help="the smallest model of this quality (SNR)"
    )
    target.add_argument(
        "--target-mb", type=above_0, metavar="MB", help="the best model whose file has this size"
    )
    parser.add_argument(
        "--quality", help="draft, medium or high (default): what is not given below"
    )
    parser.add_argument("--ranks", type=counts, default={}, help="light=20,view=4,y=32,x=32")
    parser.add_argument("--clusters", type=counts, default={}, help="view=7")
    parser.add_argument("--mixtures", type=counts, default={}, help="view=3")
    parser.add_argument(
        "--global",
        dest="global_modes",
        help="modes whose basis clusters share: light for cta and kcta, y,x for mkcta by default",
    )
    parser.add_argument(
        "--encoding",
        choices=ENCODINGS,
        help="what is fitted of occlusion: signed distance (default) or mask",
    )
    parser.add_argument(
        "--search", default="auto", help="kcta, greedy or optimal; auto (default) as in the papers"
    )
    parser.add_argument(
        "--coarse",
        type=from_1,
        default=1,
        metavar="N",
        help="begin with texels averaged over N along x and y: faster for large patches",
    )
    parser.add_argument(
        "--domain",
        default="linear",
        help="log fits log luminance with chroma: errors alike in the dark and in the light",
    )
    parser.add_argument(
        "--weights",
        choices=WEIGHTS,
        help="how errors count: by how much lighter or darker they look (lightness; default where "
        "a quality chooses the ranks) or all alike (equal; default where --ranks ... do)",
    )
    parser.add_argument(
        "--ensemble",
        type=Path,
        action="append",
        default=[],
        help="for sparse: what `train` made, or the authors' folder; of several, the one that fits "
        "(default: Nacre's own, for the 81 and the 151 directions of Bonn)",
    )
    parser.add_argument(
        "--sparsity",
        type=counts,
        default={},
        help="for sparse: y=256,uv=32 coefficients a patch; else SparseBTF(64)'s",
    )
    parser.add_argument("--seed", type=from_0, default=0)
    parser.add_argument("--threads", type=from_0, default=0, help="0 for every core")
    parser.add_argument(
        "--memory", type=gigabytes, default=0, metavar="GB", help="how much the fit may take"
    )
    parser.add_argument(
        "--resume", action="store_true", help="go on with a fit of this model that was interrupted"
    )


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..datasets.dataset import open_dataset
    from ..datasets.occlusion import with_value
    from ..datasets.quality import beyond_noise
    from ..models.exr import check_destination, save_model
    from ..models.fit import METHODS
    from .info import describe_model

    dataset = open_dataset(options.dataset)
    if dataset.kind == "occlusion":
        dataset = with_value(dataset, ENCODINGS[options.encoding or "distance"])
    elif options.encoding:
        raise NacreError(f"{options.dataset}: --encoding is for occlusion")
    check_destination(options.model)
    if options.method == "sparse":
        return _sparse(dataset, options, progress)
    for name in ("ensemble", "sparsity"):
        if getattr(options, name):
            raise NacreError(f"--{name} is for --method sparse")
    if options.method not in METHODS:
        expected = ", ".join((*METHODS, "sparse"))
        raise NacreError(f"method {options.method!r}: expected one of {expected}")
    modes = options.global_modes
    shared = {
        "global_modes": modes if modes is None else tuple(filter(None, modes.split(","))),
        "search": options.search,
        "seed": options.seed,
        "threads": options.threads,
        "memory": options.memory,
        "progress": progress,
    }
    by_target = options.target_db is not None or options.target_mb is not None
    model = (_by_target if by_target else _by_settings)(dataset, options, shared)
    save_model(model, options.model)
    note = beyond_noise(model.fit.get("snr_db"), dataset.noise_floor_db)
    return describe_model(model, options.model) | ({"note": note} if note else {})


def _sparse(dataset: Dataset, options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..models.sparse.coding import code
    from ..models.sparse.ensemble import choose
    from ..models.sparse.files import ensembles_of, save_sparse
    from .info import describe_sparse

    for name in ("target_db", "target_mb", *_BY_HAND, "global_modes"):
        if name != "resume" and getattr(options, name):
            raise NacreError(f"--{name.replace('_', '-')} does not go with sparse: see --sparsity")
    ensemble = choose(ensembles_of(options.ensemble), dataset)
    sparsity: dict[str, int] | int = _SPARSE_QUALITY
    if options.sparsity:
        sparsity = sparsity_parts(options.sparsity, tuple(ensemble.dictionaries))
    model = code(
        dataset,
        ensemble,
        sparsity,
        threads=options.threads,
        memory=options.memory,
        state=_state_of(options.model),
        resume=options.resume,
        progress=progress,
    )
    save_sparse(model, options.model)
    return describe_sparse(model, options.model)


def _state_of(model: Path) -> Path:
    """Where an interrupted fit of a model keeps its state."""
    return model.with_name(f".{model.name}.fit")


def _by_target(
    dataset: Dataset, options: argparse.Namespace, shared: dict[str, Any]
) -> ClusteredTucker:
    from ..models.target import compress_to_target

    given = {name: getattr(options, name) for name in _BY_HAND} | {"coarse": options.coarse > 1}
    for name, value in given.items():
        if value:
            raise NacreError(f"--{name} does not go with a target: leave one of them out")
    if options.domain != "linear":
        raise NacreError("--domain does not go with a target, which is of linear values")
    return compress_to_target(
        dataset,
        options.method,
        snr_db=options.target_db,
        megabytes=options.target_mb,
        folder=options.model.parent,
        **shared,
    )


def _by_settings(
    dataset: Dataset, options: argparse.Namespace, shared: dict[str, Any]
) -> ClusteredTucker:
    from ..models.fit import QUALITIES, QUALITY, compress, quality_settings
    from ..models.lightness import compress_by_lightness

    quality = (options.quality or QUALITY).upper()
    if quality not in QUALITIES:
        raise NacreError(f"quality {options.quality!r}: expected draft, medium or high")
    settings: dict[str, Any] = quality_settings(dataset, options.method, quality)
    if options.clusters:  # they say which modes are clustered
        most = max(settings.get("mixtures", {"": 1}).values())
        settings["clusters"] = options.clusters
        settings["mixtures"] = {mode: min(most, count) for mode, count in options.clusters.items()}
    for name in ("ranks", "mixtures"):
        settings[name] = {**settings.get(name, {}), **getattr(options, name)}
    shared = {
        **settings,
        "coarse": options.coarse,
        "state": _state_of(options.model),
        "resume": options.resume,
        **shared,
    }
    if _by_lightness(dataset, options):
        return compress_by_lightness(dataset, options.method, folder=options.model.parent, **shared)
    return compress(dataset, options.method, domain=options.domain, **shared)


def _by_lightness(dataset: Dataset, options: argparse.Namespace) -> bool:
    """Whether errors are weighed by lightness."""
    if options.weights:
        if options.weights == "lightness" and options.domain != "linear":
            raise NacreError("--weights lightness does not go with --domain: leave one of them out")
        return bool(options.weights == "lightness")
    by_hand = options.ranks or options.clusters or options.mixtures
    chosen = by_hand or options.domain != "linear"
    return dataset.kind == "btf" and not chosen
