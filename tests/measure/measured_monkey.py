"""A measurement in a process of its own, to be killed: `python jobs.py FOLDER`."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.datasets.direction_sets import direction_set  # noqa: E402
from addon.measure.btf import measure_btf  # noqa: E402
from addon.measure.patch import Patch  # noqa: E402
from addon.measure.settings import Settings  # noqa: E402

LIGHTS = 12


def measure(path: Path, stop_at: str | None = None, **options) -> None:
    """A rough surface under a dozen lights; a line for each picture that begins."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    collection = bpy.data.collections.new("Patch")
    bpy.ops.mesh.primitive_monkey_add(size=0.8)
    collection.objects.link(bpy.context.object)
    bpy.ops.mesh.primitive_plane_add(size=1.0, location=(0, 0, -0.4))
    collection.objects.link(bpy.context.object)

    def progress(fraction: float, message: str) -> bool:
        print(message, flush=True)
        return stop_at is None or not message.startswith(stop_at)

    measure_btf(
        Patch(collection, (1.0, 1.0)),
        path,
        direction_set(f"uniform:{LIGHTS}"),
        direction_set("uniform:6"),
        Settings(16, 4),
        progress=progress,
        **options,
    )


if __name__ == "__main__":
    measure(Path(sys.argv[1]))
