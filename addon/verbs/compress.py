"""Fit a model to a dataset."""

import argparse
from pathlib import Path
from typing import Any

from ..errors import NacreError
from .arguments import Progress, counts, from_0, from_1, gigabytes

ENCODINGS = {"distance": "signed-distance", "mask": "mask"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", type=Path)
    parser.add_argument("model", type=Path)
    parser.add_argument("--method", default="kcta", help="nsvd, cta, kcta (default) or mkcta")
    parser.add_argument(
        "--quality", default="medium", help="draft, medium or high: what is not given below"
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
    if options.clusters:  # they say which modes are clustered
        most = max(settings.get("mixtures", {"": 1}).values())
        settings["clusters"] = options.clusters
        settings["mixtures"] = {mode: min(most, count) for mode, count in options.clusters.items()}
    for name in ("ranks", "mixtures"):
        settings[name] = {**settings.get(name, {}), **getattr(options, name)}
    modes = options.global_modes
    model = compress(
        dataset,
        options.method,
        **settings,
        global_modes=modes if modes is None else tuple(filter(None, modes.split(","))),
        search=options.search,
        coarse=options.coarse,
        seed=options.seed,
        threads=options.threads,
        memory=options.memory,
        state=options.model.with_name(f".{options.model.name}.fit"),
        resume=options.resume,
        progress=progress,
    )
    save_model(model, options.model)
    return describe_model(model, options.model)
