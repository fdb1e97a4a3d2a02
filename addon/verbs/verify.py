"""Render every evaluator and compare it with decode."""

import argparse
from pathlib import Path
from typing import Any

from ..errors import NacreError
from .arguments import Progress
from .blender import need_blender


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("model", type=Path)
    parser.add_argument(
        "--engine", action="append", help="eevee, cycles or glsl; all that run here when not given"
    )


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    need_blender()
    from ..models.exr import load_model
    from ..render.engines import ENGINES, engines_here
    from ..render.verify import verify

    engines = options.engine or engines_here()
    for engine in engines:
        if engine not in ENGINES:
            raise NacreError(f"engine {engine!r}: expected one of {', '.join(ENGINES)}")
    return verify(load_model(options.model), engines, progress)
