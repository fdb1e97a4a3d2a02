"""What N-SVD, K-CTA and MK-CTA of one size look like: images of the glossiest material.

`python -m benchmarks.pictures [FOLDER] [--only NAME]` writes out/bench/methods_NAME.png: samples
and the three models (Lego's parameters, all ranks of x and y) for three pairs of a light and a
view, and below each its error, four times brighter.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ._data import OUT, arguments, glossiest, materials
from ._methods import fit
from ._papers import MKCTA, mkcta_settings
from .recipes.sheet import write_png

PAIRS = ((9, 20), (30, 12), (50, 61))
BRIGHTER = 4
SCALE = 2
GAP = 4


def main() -> None:
    options = arguments("pictures", __doc__)
    found = materials(options.folder, options.only)
    name = glossiest(found)
    dataset = found[name]
    columns = [[np.asarray(dataset.samples[pair], np.float32) for pair in PAIRS]]
    for setting in mkcta_settings(dataset, MKCTA["Lego"])[1:]:
        one = fit(dataset, replace(setting, ranks=(*setting.ranks[:2], *dataset.shape[2:4])))
        print(f"{setting.method}: {one.snr:.2f} dB, {one.mb:.2f} MB")
        columns.append(
            [one.model.decode([light], [view])[0, 0].clip(0, None) for light, view in PAIRS]
        )
    sheet = np.concatenate([_column(images, columns[0]) for images in columns], axis=1)[:, GAP:]
    path = OUT / f"methods_{name}.png"
    write_png(sheet.astype(np.float32), path)
    print(f"samples, N-SVD, K-CTA, MK-CTA from left to right: {path}")


def _column(images: list[np.ndarray], truth: list[np.ndarray]) -> np.ndarray:
    """Images and their errors one above the other, the first on top; rows upward."""
    tiles = []
    for image, exact in zip(images, truth, strict=True):
        for tile in (image, BRIGHTER * np.abs(image - exact)):
            large = tile.repeat(SCALE, 0).repeat(SCALE, 1)
            tiles.append(np.pad(large, ((0, GAP), (GAP, 0), (0, 0)), constant_values=1.0))
    return np.concatenate(tiles[::-1])


if __name__ == "__main__":
    main()
