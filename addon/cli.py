"""The command line: `blender --command nacre VERB ...` and `python -m addon VERB ...`."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from .errors import NacreError

# Each verb imports what it needs when it runs: most work without Blender, and none should wait for
# packages it does not use.


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb; 0 when it succeeded, 2 and one line on standard error when the user erred."""
    options: argparse.Namespace | None = None
    try:
        options = _parser().parse_args(arguments)
        result = options.run(options)
    except NacreError as error:
        print(f"nacre: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("nacre: cancelled", file=sys.stderr)
        return 130
    if options.json:
        print(json.dumps(result))
    else:
        for line in _lines(result):
            print(line)
    return 0


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise NacreError(f"{message} (`{self.prog} --help` explains)")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="nacre", description=__doc__)
    verbs = parser.add_subparsers(required=True, metavar="VERB", parser_class=_Parser)

    def verb(name: str, run: Callable[[argparse.Namespace], Any], text: str) -> Any:
        sub = verbs.add_parser(name, help=text, description=text)
        sub.add_argument("--json", action="store_true", help="print one JSON object")
        sub.set_defaults(run=run)
        return sub

    sub = verb("import", _import, "read any measured format into a dataset")
    sub.add_argument("source", type=Path)
    sub.add_argument("dataset", type=Path)
    sub.add_argument("--format", help="the reader to use, where the file does not tell")
    sub.add_argument(
        "--cosine", type=int, choices=(0, 1), help="whether values include cos(theta) of the light"
    )

    sub = verb("info", _info, "say what a dataset, model or measured file is")
    sub.add_argument("path", type=Path)

    sub = verb("compress", _compress, "fit a model to a dataset")
    sub.add_argument("dataset", type=Path)
    sub.add_argument("model", type=Path)
    sub.add_argument("--method", default="kcta", help="nsvd, cta or kcta (default)")
    sub.add_argument(
        "--quality", default="medium", help="draft, medium or high: what is not given below"
    )
    sub.add_argument("--ranks", type=_counts, help="light=20,view=4,y=32,x=32")
    sub.add_argument("--clusters", type=_counts, help="view=7")
    sub.add_argument("--mixtures", type=_counts, help="view=3")
    sub.add_argument(
        "--global", dest="global_modes", default="light", help="modes whose basis clusters share"
    )
    sub.add_argument("--seed", type=int, default=0)
    sub.add_argument("--threads", type=int, default=0, help="0 for every core")

    sub = verb("decode", _decode, "turn a model back into samples")
    sub.add_argument("model", type=Path)
    sub.add_argument("dataset", type=Path)
    for axis in ("light", "view", "y", "x"):
        sub.add_argument(f"--{axis}", type=_range, default=slice(None), metavar="I:J")
    sub.add_argument(
        "--directions",
        type=Path,
        help="CSV of theta,phi in degrees: every light and view of the list, from the same tables "
        "that materials show, clamped at 0",
    )

    sub = verb("compare", _compare, "measure how far B is from A: datasets, models or pictures")
    sub.add_argument("a", type=Path)
    sub.add_argument("b", type=Path)

    sub = verb("verify", _verify, "render every evaluator and compare it with decode")
    sub.add_argument("model", type=Path)
    sub.add_argument("--engine", action="append", help="eevee or cycles; both when not given")

    sub = verb("material", _material, "write a .blend with the material, ready to append")
    sub.add_argument("model", type=Path)
    sub.add_argument("out", type=Path)

    sub = verb("render", _render, "render a picture of a model")
    sub.add_argument("model", type=Path)
    sub.add_argument("out", type=Path, help=".png in Blender's Standard view, or linear .exr")
    sub.add_argument("--engine", default="eevee", help="eevee or cycles")
    sub.add_argument("--light", type=_angles, default=(45.0, 45.0), metavar="T,P")
    sub.add_argument("--view", type=_angles, metavar="T,P")
    sub.add_argument(
        "--mesh", default="plane", help="plane (the patch, square to it), cloth, sphere or a file"
    )
    sub.add_argument("--size", type=_size_of_picture, metavar="WxH")
    sub.add_argument("--samples", type=_positive, default=16, help="a pixel, for objects")
    return parser


def _import(options: argparse.Namespace) -> dict[str, Any]:
    from .datasets.importing import import_dataset

    with Progress() as progress:
        dataset = import_dataset(
            options.source,
            options.dataset,
            format=options.format,
            cosine=options.cosine,
            progress=progress,
        )
    return _describe_dataset(dataset)


def _info(options: argparse.Namespace) -> dict[str, Any]:
    from .datasets.dataset import DESCRIPTION, open_dataset
    from .datasets.importing import describe_source

    if (options.path / DESCRIPTION).is_file():
        return _describe_dataset(open_dataset(options.path))
    if options.path.suffix.lower() == ".exr":
        from .models.exr import load_model

        return _describe_model(load_model(options.path), options.path)
    return describe_source(options.path)


def _compress(options: argparse.Namespace) -> dict[str, Any]:
    from .datasets.dataset import open_dataset
    from .models.exr import save_model
    from .models.fit import METHODS, QUALITIES, compress, quality_settings

    dataset = open_dataset(options.dataset)
    quality = options.quality.upper()
    if quality not in QUALITIES:
        raise NacreError(f"quality {options.quality!r}: expected draft, medium or high")
    if options.method not in METHODS:
        raise NacreError(f"method {options.method!r}: expected one of {', '.join(METHODS)}")
    settings = quality_settings(dataset, options.method, quality)
    for name in ("ranks", "clusters", "mixtures"):
        given = getattr(options, name)
        if given:
            settings[name] = {**settings.get(name, {}), **given}
    with Progress() as progress:
        model = compress(
            dataset,
            options.method,
            **settings,
            global_modes=tuple(filter(None, options.global_modes.split(","))),
            seed=options.seed,
            threads=options.threads,
            progress=progress,
        )
    save_model(model, options.model)
    return _describe_model(model, options.model)


def _decode(options: argparse.Namespace) -> dict[str, Any]:
    import numpy as np

    from .datasets.dataset import DatasetWriter, open_dataset
    from .models.exr import load_model

    model = load_model(options.model)
    lights = np.asarray(model.dataset["light"])
    views = np.asarray(model.dataset["view"])
    if options.directions:
        from .datasets.directions import read_directions_csv
        from .tables.evaluate import evaluate_patch
        from .tables.tables import build_tables

        lights = views = read_directions_csv(options.directions)
        tables = build_tables(model)
    lights, views = lights[options.light], views[options.view]
    rows, columns = (np.arange(n)[s] for n, s in zip(model.shape[2:4], (options.y, options.x)))
    shape = (len(lights), len(views), len(rows), len(columns), model.channels)
    if not all(shape):
        raise NacreError(f"the range leaves no samples: the model has shape {model.shape}")
    width, height = model.dataset["patch_size"]  # type: ignore[misc]
    description = {
        "nacre": 1,
        "kind": "btf",
        "axes": ["light", "view", "y", "x", "channel"],
        "light": lights.tolist(),
        "view": views.tolist(),
        "channels": model.dataset["channels"],
        "patch_size": [
            width * len(columns) / model.shape[3],
            height * len(rows) / model.shape[2],
        ],
        "periodic": model.dataset["periodic"] and shape[2:4] == model.shape[2:4],
        "noise_floor_db": model.dataset["noise_floor_db"],
        "source": model.dataset["source"],
    }
    light_numbers = np.arange(model.shape[0])[options.light]
    with (
        Progress() as progress,
        DatasetWriter(options.dataset, description, shape, np.float32) as writer,
    ):
        for number in range(len(lights)):
            if options.directions:
                block = evaluate_patch(tables, lights[number : number + 1], views)
                block = block[:, :, options.y, options.x]
            else:
                block = model.decode(
                    light_numbers[number : number + 1], options.view, options.y, options.x
                )
            writer.write(block)
            progress(writer.fraction, "Decoding")
    return _describe_dataset(open_dataset(options.dataset))


def _compare(options: argparse.Namespace) -> dict[str, Any]:
    from .datasets.quality import compare_blocks
    from .samples import open_samples

    a, b = open_samples(options.a), open_samples(options.b)
    if a.shape != b.shape:
        raise NacreError(f"{options.a} has shape {a.shape} and {options.b} {b.shape}")
    peak = 1.0 if options.a.suffix.lower() == ".png" else None
    measures = compare_blocks(zip(a.blocks(), b.blocks(), strict=True), peak)
    return {**measures, "bytes_a": a.bytes, "bytes_b": b.bytes}


def _verify(options: argparse.Namespace) -> dict[str, Any]:
    _need_blender()
    from .models.exr import load_model
    from .render.engines import ENGINES
    from .render.verify import verify

    with Progress() as progress:
        return verify(load_model(options.model), options.engine or ENGINES, progress)


def _material(options: argparse.Namespace) -> dict[str, Any]:
    _need_blender()
    from .render.blend_file import write_blend

    if options.out.suffix.lower() != ".blend":
        raise NacreError(f"{options.out}: expected a name that ends in .blend")
    material = _build_material(options.model)
    write_blend(options.out, material)
    return {"material": material.name, "file": str(options.out), **_size(options.out)}


def _render(options: argparse.Namespace) -> dict[str, Any]:
    _need_blender()
    from .models.exr import load_model
    from .render.engines import check_picture, render_to
    from .render.pictures import flat_scene, object_scene

    check_picture(options.out, options.engine)
    _, _, height, width, _ = load_model(options.model).shape
    started = time.monotonic()
    material = _build_material(options.model)
    if options.mesh == "plane":
        with flat_scene(material, options.size or (width, height), options.engine) as flat:
            flat.aim(options.light, options.view or (0.0, 0.0))
            render_to(flat.scene, options.out)
    else:
        view = options.view or (35.0, 290.0)
        with object_scene(
            material,
            options.mesh,
            options.size or (640, 480),
            options.engine,
            options.light,
            view,
            options.samples,
        ) as scene:
            render_to(scene, options.out)
    seconds = round(time.monotonic() - started, 3)
    return {"file": str(options.out), "engine": options.engine, "seconds": seconds}


def _build_material(path: Path) -> Any:
    from .models.exr import load_model
    from .nodes.material import material_from_tables
    from .tables.tables import build_tables

    with Progress() as progress:
        return material_from_tables(build_tables(load_model(path), progress=progress), path.stem)


def _describe_dataset(dataset: Any) -> dict[str, Any]:
    lights, views, height, width, _ = dataset.shape
    return {
        "what": "dataset",
        "kind": dataset.kind,
        "light": lights,
        "view": views,
        "width": width,
        "height": height,
        "channels": list(dataset.channels),
        "dtype": dataset.samples.dtype.name,
        "patch_size": list(dataset.patch_size),
        "raw_bytes": dataset.raw_bytes,
        "source": dataset.source,
    }


def _describe_model(model: Any, path: Path) -> dict[str, Any]:
    size = path.stat().st_size
    return {
        "what": "model",
        **{key: value for key, value in model.fit.items() if key != "errors"},
        "shape": list(model.shape),
        "ranks": model.ranks,
        "clusters": dict(model.clusters),
        "mixtures": model.mixtures,
        "bytes": size,
        "ratio": round(model.dataset["raw_bytes"] / size, 2),
        "source": model.dataset["source"],
    }


def _size(path: Path) -> dict[str, int]:
    return {"bytes": path.stat().st_size}


def _need_blender() -> None:
    try:
        import bpy  # noqa: F401
    except ImportError as error:
        raise NacreError(
            "this needs Blender: run `blender --command nacre ...`, or install the bpy wheel"
        ) from error


def _counts(text: str) -> dict[str, int]:
    try:
        pairs = [entry.split("=") for entry in text.split(",")]
        return {mode.strip(): int(value) for mode, value in pairs}
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form view=4,y=32") from None


def _range(text: str) -> slice:
    try:
        first, last = (int(part) if part else None for part in text.split(":"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form 3:7") from None
    return slice(first, last)


def _angles(text: str) -> tuple[float, float]:
    try:
        theta, phi = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form 45,90 (degrees)") from None
    if not 0.0 <= theta <= 90.0:
        raise argparse.ArgumentTypeError(f"theta {theta:g} is not between 0 and 90 degrees")
    return theta, phi


def _size_of_picture(text: str) -> tuple[int, int]:
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form 640x480") from None
    if not (0 < width <= 16384 and 0 < height <= 16384):
        raise argparse.ArgumentTypeError(f"{text!r}: each side is between 1 and 16384 pixels")
    return width, height


def _positive(text: str) -> int:
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of 1 or more")
    return value


def _lines(result: dict[str, Any], indent: str = "") -> list[str]:
    """A result for people: one line a value, nested ones indented."""
    lines = []
    for key, value in result.items():
        if isinstance(value, dict):
            lines += [f"{indent}{key}", *_lines(value, indent + "  ")]
        else:
            lines.append(f"{indent}{key:<16} {value}")
    return lines


class Progress:
    """A progress callback that writes one changing line to a terminal, with the time left."""

    def __init__(self) -> None:
        self.started = time.monotonic()
        self.shown = False

    def __call__(self, fraction: float, message: str) -> bool:
        if sys.stderr.isatty():
            left = (time.monotonic() - self.started) * (1.0 - fraction) / max(fraction, 1e-3)
            rest = f"{left:4.0f} s left" if fraction > 0.02 else ""
            print(f"\r{message:<40.40} {fraction:4.0%} {rest:<12}", end="", file=sys.stderr)
            self.shown = True
        return True

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self.shown:
            print(f"\r{'':<64}\r", end="", file=sys.stderr, flush=True)
