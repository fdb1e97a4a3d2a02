"""Render a picture of a model, or of a scene."""

import argparse
import time
from pathlib import Path
from typing import Any

from .arguments import Progress, angles, from_1, picture_size
from .blender import build_material, need_blender


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "model",
        type=Path,
        help="or a .blend file, whose scene is rendered as it is, before its compositor",
    )
    parser.add_argument("out", type=Path, help=".png in Blender's Standard view, or linear .exr")
    parser.add_argument("--engine", default="eevee", help="eevee, cycles or glsl")
    parser.add_argument("--light", type=angles, default=(45.0, 45.0), metavar="T,P")
    parser.add_argument("--view", type=angles, metavar="T,P")
    parser.add_argument(
        "--mesh", default="plane", help="plane (the patch, square to it), cloth, sphere or a file"
    )
    parser.add_argument("--size", type=picture_size, metavar="WxH")
    parser.add_argument("--samples", type=from_1, default=16, help="a pixel, for objects")


def run(options: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    need_blender()
    from ..models.any_model import load_shown
    from ..render.engines import check_picture, render_to
    from ..render.pictures import flat_scene, object_scene

    check_picture(options.out, options.engine)
    if options.model.suffix == ".blend":
        return _render_scene(options)
    model = load_shown(options.model)
    started = time.monotonic()
    if options.engine == "glsl":
        from ..render.glsl import flat_picture, object_picture
        from ..tables.any_tables import build_any_tables

        tables = build_any_tables(model, progress=progress)
        if options.mesh == "plane":
            view = options.view or (0.0, 0.0)
            flat_picture(tables, options.out, options.light, view, options.size)
        else:
            object_picture(
                tables,
                options.out,
                options.mesh,
                options.size or (640, 480),
                options.light,
                options.view or (35.0, 290.0),
                options.samples,
            )
        seconds = round(time.monotonic() - started, 3)
        return {"file": str(options.out), "engine": options.engine, "seconds": seconds}
    material = build_material(model, options.model.stem, progress)
    _, _, height, width, _ = model.shape
    if options.mesh == "plane":
        with flat_scene(material, options.size or (width, height), options.engine) as flat:
            flat.aim(options.light, options.view or (0.0, 0.0))
            render_to(flat.scene, options.out)
    else:
        with object_scene(
            material,
            options.mesh,
            options.size or (640, 480),
            options.engine,
            options.light,
            options.view or (35.0, 290.0),
            options.samples,
        ) as scene:
            render_to(scene, options.out)
    seconds = round(time.monotonic() - started, 3)
    return {"file": str(options.out), "engine": options.engine, "seconds": seconds}


def _render_scene(options: argparse.Namespace) -> dict[str, Any]:
    import bpy

    from ..measure.scene_file import open_scene
    from ..render.comparison import render_scene

    started = time.monotonic()
    open_scene(options.model)
    render_scene(bpy.context.scene, options.engine, options.out)
    seconds = round(time.monotonic() - started, 3)
    return {"file": str(options.out), "engine": options.engine, "seconds": seconds}
