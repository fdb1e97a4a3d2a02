"""Measure a scene with Cycles as the instrument, into a dataset."""

import argparse
from pathlib import Path
from typing import Any

from ..errors import NacreError
from .arguments import Progress, above_0, from_0, from_1, lengths, part_of
from .blender import need_blender


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", type=Path, help="the .blend file")
    parser.add_argument("dataset", type=Path)
    parser.add_argument(
        "--kind",
        choices=("btf", "occlusion"),
        default="btf",
        help="btf (default), or occlusion: where holes let one see through",
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--object", metavar="NAME", help="an object, centred on its origin")
    what.add_argument(
        "--collection", metavar="NAME", help="a collection, centred on its instance offset"
    )
    what.add_argument("--material", metavar="NAME", help="a material, on a plane")
    parser.add_argument(
        "--size",
        type=lengths,
        metavar="W[,H]",
        help="width and height in metres after which the patch repeats; an object's own by default",
    )
    parser.add_argument(
        "--views", default="ubo81", metavar="SET", help="ubo81 (default), ubo151, utia, uniform:N "
        "or a CSV file of theta,phi in degrees"
    )  # fmt: skip
    parser.add_argument(
        "--lights", metavar="SET", help="as --views; ubo81 by default, and none for occlusion"
    )
    parser.add_argument("--texels", type=from_1, default=64, help="along the patch's width (64)")
    noise = parser.add_mutually_exclusive_group()
    noise.add_argument("--samples", type=from_1, help="paths through each texel (16)")
    noise.add_argument(
        "--noise", type=above_0, metavar="DB", help="noise floor to reach, instead of samples"
    )
    parser.add_argument("--bounces", type=from_0, help="of light between surfaces (4)")
    parser.add_argument("--seed", type=from_0, help="of the first picture's noise (0)")
    parser.add_argument(
        "--value", choices=("mask", "signed-distance"), help="what occlusion holds (mask)"
    )
    parser.add_argument(
        "--part",
        type=part_of,
        metavar="I/N",
        help="measure the I-th N-th of the lights, to be joined by `merge`; with N the number of "
        "lights, I is a farm's frame number",
    )
    again = parser.add_mutually_exclusive_group()
    again.add_argument(
        "--resume",
        action="store_true",
        help="go on with an unfinished measurement although the scene was saved since; without "
        "changes that needs no option",
    )
    again.add_argument(
        "--restart", action="store_true", help="throw an unfinished measurement away"
    )


_OF_BTF = ("lights", "samples", "noise", "bounces", "seed", "part", "resume", "restart")
_OF_OCCLUSION = ("value",)
_KINDS = ("object", "collection", "material")


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    need_blender()
    from ..datasets.dataset import check_destination
    from ..datasets.direction_sets import direction_set
    from ..measure.request import Request, measure
    from ..measure.scene_file import find_item, open_scene
    from ..measure.settings import Settings
    from .info import describe_dataset

    others = _OF_OCCLUSION if options.kind == "btf" else _OF_BTF
    for name in others:
        if getattr(options, name):
            raise NacreError(f"--{name} does not go with --kind {options.kind}")

    def given(**names: str) -> dict[str, Any]:
        """What was given on the command line, under other names."""
        values = {name: getattr(options, option) for name, option in names.items()}
        return {name: value for name, value in values.items() if value is not None}

    settings = given(samples="samples", noise_db="noise", bounces="bounces", seed="seed")
    request = Request(
        kind=options.kind,
        size=options.size,
        views=options.views,
        settings=Settings(options.texels, **settings),
        resume=options.resume,
        restart=options.restart,
        **given(lights="lights", value="value", part="part"),
    )
    # Opening a large scene takes long: what can be wrong before that is found first.
    check_destination(options.dataset)
    for name in (request.views, request.lights):
        direction_set(name)
    kind = next((kind for kind in _KINDS if getattr(options, kind) is not None), None)
    origin = open_scene(options.scene)
    item = find_item(kind, kind and getattr(options, kind))
    return describe_dataset(
        measure(item, options.dataset, request, origin=origin, progress=progress)
    )
