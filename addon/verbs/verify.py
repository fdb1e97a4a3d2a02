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
    from ..models.any_model import load_shown
    from ..render.engines import ENGINES
    from ..render.verify import verify

    for engine in options.engine or ():
        if engine not in ENGINES:
            raise NacreError(f"engine {engine!r}: expected one of {', '.join(ENGINES)}")
    model = load_shown(options.model)
    return verify(model, options.engine, progress)
