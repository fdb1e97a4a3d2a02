"""Write a .blend with the material, ready to append."""

import argparse
from pathlib import Path
from typing import Any

from ..errors import NacreError
from .arguments import Progress
from .blender import build_material, need_blender

CYCLES = "Cycles shows this sparse model with Open Shading Language, on the CPU"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("model", type=Path)
    parser.add_argument("out", type=Path)


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    need_blender()
    from ..models.any_model import load_shown
    from ..nodes.material import needs_osl
    from ..render.blend_file import write_blend

    if options.out.suffix.lower() != ".blend":
        raise NacreError(f"{options.out}: expected a name that ends in .blend")
    material = build_material(load_shown(options.model), options.model.stem, progress)
    write_blend(options.out, material)
    found: dict[str, Any] = {"note": CYCLES} if needs_osl(material) else {}
    return {
        "material": material.name,
        "file": str(options.out),
        "bytes": options.out.stat().st_size,
        **found,
    }
