"""What SparseBTF of each quality looks like on materials that were not trained on.

    python -m benchmarks.sparse_pictures [FOLDER]

FOLDER is that of benchmarks.sparse_quality, with its ensemble of eight dictionaries. Writes
out/bench/sparse_quality.png: samples, SparseBTF(16) to (256) and PCA(64), whose basis is learned
from the same materials as the dictionaries, each for two pairs of light and view.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from addon.datasets.directions import spherical_to_unit
from addon.models.sparse.coding import code

from ._data import OUT
from ._pca import Pca
from ._sparse_sets import QUALITIES, TRAINING, UNSEEN, datasets, parser, trained
from .recipes.sheet import write_png

PAIRS = (((45, 0), (30, 180)), ((60, 75), (15, 270)))  # theta, phi of light and view
DICTIONARIES = 8
SCALE, GAP = 3, 6


def main() -> None:
    folder = parser("sparse_pictures", __doc__).parse_args().folder
    ensemble = trained(DICTIONARIES, folder, "ubo151")
    materials = list(datasets(TRAINING, folder, "ubo151").values())
    pca = Pca.learned(materials, 64)
    rows = []
    for dataset in datasets(UNSEEN, folder, "ubo151").values():
        model = code(dataset, ensemble, QUALITIES[-1])
        pairs = [tuple(_nearest(own, angles) for own, angles in
                       zip((dataset.light, dataset.view), pair, strict=True))
                 for pair in PAIRS]  # fmt: skip
        for (light, view), of_pca in zip(pairs, pca.pictures(dataset, pairs), strict=True):
            tiles = [np.asarray(dataset.samples[light, view], np.float32)]
            tiles += [model.truncated(quality).decode([light], [view])[0, 0]
                      for quality in QUALITIES]  # fmt: skip
            rows.append(_row([*tiles, of_pca]))
    path = OUT / "sparse_quality.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_png(np.concatenate(rows[::-1])[:-GAP, GAP:].astype(np.float32), path)
    print(f"samples, SparseBTF {QUALITIES}, PCA (64), learned, from left to right: {path}")


def _nearest(measured: NDArray[np.floating], angles: tuple[float, float]) -> int:
    """The measured direction nearest to a polar angle and azimuth in degrees."""
    return int(np.argmax(measured @ spherical_to_unit(*angles)[0]))


def _row(images: list[NDArray[np.floating]]) -> NDArray[np.floating]:
    """Tiles of one brightness side by side; rows upward."""
    white = np.percentile(images[0], 98)
    tiles = []
    for image in images:
        large = (image.clip(0, None) / white).repeat(SCALE, 0).repeat(SCALE, 1)
        tiles.append(np.pad(large, ((0, GAP), (GAP, 0), (0, 0)), constant_values=1.0))
    return np.concatenate(tiles, 1)


if __name__ == "__main__":
    main()
