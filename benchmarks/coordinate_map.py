"""Coordinate maps: materials laid anew without seams or visible repetition.

`python -m benchmarks.coordinate_map [FOLDER] [--only NAMES]` prints, for K-CTA models of medium
quality: the time for a map of 256 x 256; how many texels are seen again one patch further, of all;
how many lie at a cut; and by how much what is beside a cut differs from what is there in the patch,
in units of the difference of any two neighbours (appearance, RMS). Writes
out/bench/coordinates_NAME.png: the patch repeated, laid anew, and the map.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from addon.datasets.directions import spherical_to_unit
from addon.models.fit import compress, quality_settings
from addon.tables.coordinate_map import SIZE, appearance, synthesize_coordinates
from addon.tables.evaluate import evaluate_patch
from addon.tables.tables import Tables, build_tables

from ._data import OUT, arguments, materials
from ._report import table
from .recipes.sheet import write_png


def main() -> None:
    options = arguments("coordinate_map", __doc__)
    rows = [["", "time", "seen again", "at a cut", "seam / step"]]
    for name, dataset in materials(options.folder, options.only).items():
        settings = quality_settings(dataset, "kcta", "MEDIUM")
        tables = build_tables(compress(dataset, "kcta", **settings), 64)
        start = perf_counter()
        found = synthesize_coordinates(tables).astype(np.intp)
        took = perf_counter() - start
        again, cut, seam = figures(found, appearance(tables))
        rows.append([name, f"{took:.1f} s", f"{again:.0%}", f"{cut:.1%}", f"{seam:.2f}"])
        write_png(picture(tables, found), OUT / f"coordinates_{name}.png")
    print(table(rows))


def figures(found: NDArray[np.intp], patch: NDArray[np.float32]) -> tuple[float, float, float]:
    """Texels seen again one patch further, texels at a cut, and the seam's error."""
    again, cuts, errors = [], [], []
    for axis in (0, 1):
        further = np.roll(found, patch.shape[axis], axis)
        again.append((found == further).all(-1).mean())
        beside = np.roll(found, -1, axis)
        stood = (found + np.eye(2, dtype=np.intp)[axis]) % patch.shape[:2]
        cut = (beside != stood).any(-1)
        change = patch[beside[..., 0], beside[..., 1]] - patch[stood[..., 0], stood[..., 1]]
        cuts.append(cut.mean())
        errors.append((change[cut] ** 2).sum(-1))
    own = np.mean([((patch - np.roll(patch, 1, axis)) ** 2).sum(-1).mean() for axis in (0, 1)])
    seam = np.sqrt(np.concatenate(errors).mean() / own)
    return float(np.mean(again)), float(np.mean(cuts)), float(seam)


def picture(tables: Tables, found: NDArray[np.intp]) -> NDArray[np.float32]:
    """Under one light from one view: repeated, laid anew, and the coordinates as red and green."""
    light, view = spherical_to_unit([45.0, 20.0], [60.0, 200.0])[:, None]
    patch = evaluate_patch(tables, light, view)[0, 0]
    height, width, _ = patch.shape
    repeated = np.tile(patch, (-(-SIZE // height), -(-SIZE // width), 1))[:SIZE, :SIZE]
    anew = patch[found[..., 0], found[..., 1]]
    colours = np.dstack([found / (height, width), np.zeros(found.shape[:2])])
    return np.concatenate([repeated, anew, colours], 1).astype(np.float32).repeat(2, 0).repeat(2, 1)


if __name__ == "__main__":
    main()
