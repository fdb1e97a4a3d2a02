"""Train the dictionaries of sparse codes on some datasets of the same directions."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..errors import NacreError
from .arguments import Progress, above_0, counts, from_0, from_1, sparsity_parts


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("datasets", type=Path, nargs="+")
    parser.add_argument("ensemble", type=Path)
    parser.add_argument(
        "--patch", type=from_1, default=8, metavar="N", help="patches of N x N texels (8)"
    )
    parser.add_argument("--dictionaries", type=from_1, default=8, metavar="K", help="of each part")
    parser.add_argument(
        "--sparsity",
        type=counts,
        default={},
        help="y=256,uv=32 (default) coefficients a patch; yuv=128 takes colour as a fifth mode",
    )
    parser.add_argument("--sweeps", type=from_1, default=30, help="at most (30)")
    parser.add_argument(
        "--precluster",
        action="store_true",
        help="choose dictionaries once, in the beginning, and every tenth sweep: faster",
    )
    parser.add_argument(
        "--offset",
        type=above_0,
        default=8.0,
        help="of the logarithm that is coded, log(1 + RGB / offset): 8 (default) is nearly linear "
        "and has the least squared error; 0.1 keeps more of what is seen",
    )
    parser.add_argument(
        "--subspace",
        type=from_1,
        default=64,
        metavar="N",
        help="train in the N leading directions of light and of view (64): as many as there are "
        "leave nothing out and take longer",
    )
    parser.add_argument("--seed", type=from_0, default=0)
    parser.add_argument("--threads", type=from_0, default=0, help="0 for every core")
    parser.add_argument(
        "--resume", action="store_true", help="go on with a training that was interrupted"
    )


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..datasets.dataset import open_dataset
    from ..models.exr import check_destination
    from ..models.sparse.files import save_ensemble
    from ..models.sparse.training import SPARSITY, train
    from .info import describe_ensemble

    path = options.ensemble
    if path.suffix == ".nacre":
        raise NacreError(f"{path}: the last name is the ensemble's and ends in .exr")
    check_destination(path)
    sparsity = dict(SPARSITY)
    if options.sparsity:
        joint = [*options.sparsity] in (["yuv"], ["YUV"])
        sparsity = sparsity_parts(options.sparsity, ("YUV",) if joint else tuple(SPARSITY))
    ensemble = train(
        [open_dataset(dataset) for dataset in options.datasets],
        patch=(options.patch, options.patch),
        dictionaries=options.dictionaries,
        sparsity=sparsity,
        sweeps=options.sweeps,
        reassign=10 if options.precluster else 1,
        offset=options.offset,
        subspace=options.subspace,
        seed=options.seed,
        threads=options.threads,
        folder=path.parent,
        state=path.with_name(f".{path.name}.training"),
        resume=options.resume,
        progress=progress,
    )
    save_ensemble(ensemble, path)
    return describe_ensemble(ensemble, path)
