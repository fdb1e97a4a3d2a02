"""Fit a model to a dataset."""

import argparse
from pathlib import Path
from typing import Any

from ..errors import NacreError
from .arguments import Progress, counts, from_0

ENCODINGS = {"distance": "signed-distance", "mask": "mask"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", type=Path)
    parser.add_argument("model", type=Path)
    parser.add_argument("--method", default="kcta", help="nsvd, cta or kcta (default)")
    parser.add_argument(
        "--quality", default="medium", help="draft, medium or high: what is not given below"
    )
    parser.add_argument("--ranks", type=counts, default={}, help="light=20,view=4,y=32,x=32")
    parser.add_argument("--clusters", type=counts, default={}, help="view=7")
    parser.add_argument("--mixtures", type=counts, default={}, help="view=3")
    parser.add_argument(
        "--global",
        dest="global_modes",
        help="modes whose basis clusters share: light by default, which occlusion lacks",
    )
    parser.add_argument(
        "--encoding",
        choices=ENCODINGS,
        help="what is fitted of occlusion: signed distance (default) or mask",
    )
    parser.add_argument("--seed", type=from_0, default=0)
    parser.add_argument("--threads", type=from_0, default=0, help="0 for every core")


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    from ..datasets.dataset import open_dataset
    from ..datasets.occlusion import with_value
    from ..models.exr import check_destination, save_model
    from ..models.fit import METHODS, QUALITIES, compress, quality_settings
    from .info import describe_model

    dataset = open_dataset(options.dataset)
    if dataset.kind == "occlusion":
        dataset = with_value(dataset, ENCODINGS[options.encoding or "distance"])
    elif options.encoding:
        raise NacreError(f"{options.dataset}: --encoding is for occlusion")
    check_destination(options.model)
    quality = options.quality.upper()
    if quality not in QUALITIES:
        raise NacreError(f"quality {options.quality!r}: expected draft, medium or high")
    if options.method not in METHODS:
        raise NacreError(f"method {options.method!r}: expected one of {', '.join(METHODS)}")
    settings = quality_settings(dataset, options.method, quality)
    for name in ("ranks", "clusters", "mixtures"):
        settings[name] = {**settings.get(name, {}), **getattr(options, name)}
    modes = options.global_modes
    model = compress(
        dataset,
        options.method,
        **settings,
        global_modes=modes if modes is None else tuple(filter(None, modes.split(","))),
        seed=options.seed,
        threads=options.threads,
        progress=progress,
    )
    save_model(model, options.model)
    return describe_model(model, options.model)
