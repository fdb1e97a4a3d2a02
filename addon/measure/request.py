"""One virtual measurement as it is asked for, by the panel or on the command line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import bpy

from ..datasets.dataset import Dataset
from ..datasets.direction_sets import direction_set
from .btf import measure_btf
from .occlusion import measure_occlusion
from .patch import open_patch
from .settings import Settings

Progress = Callable[[float, str], bool]


@dataclass(frozen=True)
class Request:
    """kind: "btf" or "occlusion", of the latter `value`: "mask" or "signed-distance".

    size: (width, height) in metres, an object's own when None. views, lights: names of
    `direction_set`. part, resume, restart: as `measure_btf` takes them.
    """

    kind: str = "btf"
    value: str = "mask"
    size: tuple[float, float] | None = None
    views: str = "ubo81"
    lights: str = "ubo81"
    settings: Settings = field(default_factory=Settings)
    part: tuple[int, int] = (1, 1)
    resume: bool = False
    restart: bool = False

    def arguments(self) -> list[str]:
        """The same for the command line's `measure`."""
        settings = self.settings
        given = [f"--kind={self.kind}", f"--views={self.views}", f"--texels={settings.width}"]
        if self.size is not None:
            given.append(f"--size={self.size[0]:.9g},{self.size[1]:.9g}")
        if self.kind == "occlusion":
            return [*given, f"--value={self.value}"]
        if settings.noise_db is None:
            given.append(f"--samples={settings.samples}")
        else:
            given.append(f"--noise={settings.noise_db:.9g}")
        given += [f"--lights={self.lights}", f"--bounces={settings.bounces}"]
        given += [f"--seed={settings.seed}", f"--part={self.part[0]}/{self.part[1]}"]
        return given + [f"--{name}" for name in ("resume", "restart") if getattr(self, name)]


def measure(
    item: bpy.types.Object | bpy.types.Collection | bpy.types.Material,
    path: str | Path,
    request: Request,
    *,
    origin: str = "",
    progress: Progress | None = None,
) -> Dataset:
    """Measure an item of the scene into the dataset folder `path`; errors as of `measure_btf`."""
    view = direction_set(request.views)
    with open_patch(item, request.size) as patch:
        if request.kind == "occlusion":
            width, value = request.settings.width, request.value
            return measure_occlusion(patch, path, view, width=width, value=value, progress=progress)
        return measure_btf(
            patch,
            path,
            direction_set(request.lights),
            view,
            request.settings,
            part=request.part,
            origin=origin,
            resume=request.resume,
            restart=request.restart,
            progress=progress,
        )
