"""A material in a .blend of its own, ready to append or to use from the asset browser."""

from __future__ import annotations

import os
from pathlib import Path

import bpy

from ..errors import NacreError


def write_blend(path: str | Path, material: bpy.types.Material) -> None:
    """Write a material, with its images packed, to `path` through a temporary name."""
    path = Path(path)
    if not path.parent.is_dir():
        raise NacreError(f"{path.parent}: no such folder; make it first")
    material.asset_mark()
    temporary = path.with_name(f".{path.stem}-partial.blend")
    try:
        bpy.data.libraries.write(str(temporary), {material}, fake_user=True, compress=True)
        os.replace(temporary, path)
    except (OSError, RuntimeError) as error:
        raise NacreError(f"{path}: could not be written ({error})") from error
    finally:
        temporary.unlink(missing_ok=True)
