"""Temporal stability: a cloth that turns before the camera, against Cycles on the real geometry.

    python -m benchmarks.turntable [FOLDER] [--only SCENES]

60 frames, 1.5 degrees apart, at a grazing view; FOLDER as for benchmarks.truth. How much each
drawing's change from frame to frame differs from Cycles' is printed as RMS: of pixels, and of
points that are followed on the surface, where the motion itself changes nothing. The mean of the
largest 0.1 % of the differences on the surface stands for what is seen as a jump. CTA is drawn as
its paper does, linear between its three nearest views, and by the tables as the others are. All
but the dataset have about the same size.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from addon.datasets.dataset import Dataset
from addon.datasets.directions import spherical_to_unit
from addon.models.exr import load_model
from addon.tables.tables import build_tables

from ._data import OUT
from ._lights import add_suns, lights
from ._measured import SCENES, measured
from ._object_pictures import (
    SPAN,
    Pixels,
    Shot,
    View,
    build,
    look_at,
    of_dataset,
    of_tables,
    place_camera,
    real_scene,
    remove_lights,
    take,
    three_views,
)
from ._report import bar, table
from ._scores import srgb
from .truth import DEFAULT, TITLES, fitted

FRAMES, STEP = 60, 1.5
SHOT = Shot("cloth", 2, 128, (58.0, 0.0))  # texels are no smaller than pixels
SAMPLES = 48
POINTS = 200
"""Points of the surface along each side of the cloth."""

Angles = NDArray[np.float64]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.turntable", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=OUT / "off_grid")
    parser.add_argument(
        "--only", nargs="+", choices=SCENES, default=["woven_hair", "displaced_voronoi"]
    )
    options = parser.parse_args()
    own = options.folder / "truth"
    own.mkdir(parents=True, exist_ok=True)
    for scene in options.only:
        dataset = measured(scene, options.folder)
        truth = rendered(scene, dataset, own)
        views = [look_at(dataset, shot) for shot in shots()]
        whole = np.stack([view.picture(view.whole) for view in views])
        mask = np.stack([view.mask for view in views])
        truth = srgb_frames(truth[..., :3], mask)
        rows = [["", "pixels", "surface", "largest 0.1 %"]]
        found = {}
        for name, frames in drawn(scene, dataset, views, own).items():
            error = srgb_frames(frames, mask) - truth
            found[name] = changes(error, mask, whole, views, shots())
            rows.append([name, *(f"{value:.4f}" for value in found[name])])
        still = changes(truth, mask, whole, views, shots())
        rows.append(["(Cycles' own change)", *(f"{value:.4f}" for value in still)])
        print(f"\n{SCENES[scene][0]}")
        print(table(rows), flush=True)
        kcta, cta = found[TITLES["kcta"]], found["CTA, three views"]
        text = (
            f"K-CTA against CTA: {kcta[1]:.4f} < {cta[1]:.4f}, jumps {kcta[2]:.4f} < {cta[2]:.4f}"
        )
        print(bar(kcta[1] < cta[1] and kcta[2] < cta[2], text))


def shots() -> list[Shot]:
    """The camera goes round the cloth, and the light with it: the same as a cloth that turns."""
    return [
        Shot(SHOT.object, SHOT.across, SHOT.size, (SHOT.camera[0], SHOT.camera[1] + STEP * frame))
        for frame in range(FRAMES)
    ]


def rendered(scene: str, dataset: Dataset, folder: Path) -> NDArray[np.float32]:
    """Cycles' frames (frame, y, x, 4), made where they are not in the folder."""
    path = folder / f"{scene} turntable {SHOT.across} {SHOT.size} {SAMPLES}.npy"
    if not path.is_file():
        frames = []
        from_above = Shot(SHOT.object, SHOT.across, SHOT.size, (0.0, 0.0))
        with real_scene(build(scene), dataset, from_above, SAMPLES) as stage:
            scale = stage.camera.data.ortho_scale / SPAN
            for frame, shot in enumerate(shots()):
                remove_lights(stage)
                add_suns(stage, lights("sun").turned(STEP * frame))
                place_camera(stage, shot, scale)
                frames.append(take(stage))
        np.save(path, frames)
    return np.load(path)


def drawn(
    scene: str, dataset: Dataset, views: list[View], folder: Path
) -> dict[str, NDArray[np.float32]]:
    """Frames (frame, y, x, 3) by how they are drawn."""
    suns = [lights("sun").turned(STEP * frame) for frame in range(FRAMES)]
    turning = list(zip(views, suns, strict=True))
    path = folder / f"{scene} turntable {SHOT.across} {SHOT.size} dataset.npy"
    if not path.is_file():
        np.save(path, [of_dataset(dataset, view, [sun])[0] for view, sun in turning])
    frames = {"dataset": np.load(path)}
    for method, file in fitted(scene, dataset, DEFAULT[1], folder).items():
        model = load_model(file)
        tables = build_tables(model)
        if method == "cta":
            frames["CTA, three views"] = np.stack(
                [of_tables(tables, v, [s], three_views(model, v))[0] for v, s in turning]
            )
        frames[TITLES[method]] = np.stack([of_tables(tables, v, [s])[0] for v, s in turning])
    return frames


def srgb_frames(frames: NDArray, mask: NDArray) -> Pixels:
    return np.stack([srgb(one)[::-1] for one in frames * mask[..., None]])


def changes(
    values: Pixels, mask: NDArray[np.bool_], whole: Pixels, views: list[View], taken: list[Shot]
) -> tuple[float, float, float]:
    """RMS of the change from frame to frame: of pixels covered in both, and of the surface's
    points; and the mean of the largest thousandth of the surface's."""
    both = mask[1:] & mask[:-1]
    pixels = np.sqrt(np.square(np.diff(values, axis=0))[both].mean())
    followed, seen = zip(
        *(
            follow(picture, place, view, shot)
            for picture, place, view, shot in zip(values, whole, views, taken, strict=True)
        ),
        strict=True,
    )
    seen = np.logical_and.reduce(seen)
    change = np.abs(np.diff(np.stack(followed), axis=0))[:, seen]
    surface = np.sqrt(np.square(change).mean())
    largest = np.sort(change.mean(-1).ravel())[-max(1, change[..., 0].size // 1000) :]
    return float(pixels), float(surface), float(largest.mean())


def follow(
    picture: Pixels, whole: Pixels, view: View, shot: Shot
) -> tuple[Pixels, NDArray[np.bool_]]:
    """A picture at points of the surface (n, 3), bilinear, and which of them the camera sees."""
    steps = np.linspace(0.05, 0.95, POINTS)
    u, v = (axis.ravel() for axis in np.meshgrid(steps, steps))
    (towards,) = spherical_to_unit(*zip(shot.camera, strict=True))
    right = np.cross((0.0, 0.0, 1.0), towards)
    right /= np.linalg.norm(right)
    points = view.shape.point(u, v) / (view.shape.unit * SPAN)
    place = np.stack([points @ right, points @ np.cross(towards, right)], -1)
    place = (place + 0.5) * shot.size - 0.5
    corner = np.clip(np.floor(place).astype(int), 0, shot.size - 2)
    along = place - corner

    def sampled(image: Pixels) -> Pixels:
        return sum(
            (np.abs(1 - dx - along[:, 0]) * np.abs(1 - dy - along[:, 1]))[:, None]
            * image[corner[:, 1] + dy, corner[:, 0] + dx]
            for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1))
        )

    near = np.abs(sampled(whole) - np.stack([u, v], -1)).max(-1) < 0.01
    return sampled(picture), near


if __name__ == "__main__":
    main()
