"""Mix two sparse models of the same directions and texels into one."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..errors import NacreError
from .arguments import Progress, counts, from_0, from_1, share, sparsity_parts


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("a", type=Path, metavar="A")
    parser.add_argument("b", type=Path, metavar="B")
    parser.add_argument("model", type=Path, metavar="OUT")
    parser.add_argument(
        "--mix", type=share, metavar="T", help="how much of B there is, 0 to 1; with --mask, of it"
    )
    parser.add_argument(
        "--mask",
        type=Path,
        metavar="FILE",
        help="a grey .png or .exr of as many texels: B where it is white, A where it is black",
    )
    size = parser.add_mutually_exclusive_group()
    size.add_argument(
        "--sparsity",
        type=counts,
        default={},
        help="y=256,uv=32 coefficients a patch; else as many as the one of A and B with more has",
    )
    size.add_argument(
        "--quality", type=from_1, metavar="N", help="coefficients of SparseBTF(N) instead"
    )
    parser.add_argument("--threads", type=from_0, default=0, help="0 for every core")


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..datasets.images.grey import read_grey
    from ..models.exr import check_destination
    from ..models.sparse.blending import bake, blend
    from ..models.sparse.files import load_sparse, save_sparse
    from .info import describe_sparse

    check_destination(options.model)
    if options.mix is None and options.mask is None:
        raise NacreError("how much of each? give --mix 0.5, or a --mask")
    of_b = 1.0 if options.mix is None else options.mix
    if options.mask is not None:
        of_b = of_b * read_grey(options.mask)
    models = [load_sparse(path) for path in (options.a, options.b)]
    try:
        mix = blend(models, [1.0 - of_b, of_b])
    except NacreError as error:
        raise NacreError(f"{options.a} and {options.b}: {error}") from error
    sparsity = options.quality
    if options.sparsity:
        sparsity = sparsity_parts(options.sparsity, tuple(models[0].codes))
    model = bake(mix, sparsity, threads=options.threads, progress=progress)
    save_sparse(model, options.model)
    return describe_sparse(model, options.model)
