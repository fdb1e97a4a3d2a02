"""One dictionary for each material, in the form of the paper's Table 6.

    python -m benchmarks.sparse_own [FOLDER] [--only NAMES]

Points are 8 x 8 x 81 x 81 x 3, colour a mode of its own; a dictionary is trained on the material
itself by 128 coefficients a point, and each point is coded by 965. PSNR is against a peak of 1 in
linear values, and against the material's largest value, as the paper does not say its own; sizes
are of 256 x 256 texels, as the paper's, with the dictionary. FOLDER holds further datasets of
81 x 81 directions (`python -m benchmarks.recipes FOLDER`).
"""

from __future__ import annotations

import numpy as np

from addon.datasets.dataset import Dataset
from addon.models.sparse.coding import code, measure
from addon.models.sparse.training import train

from ._data import arguments, materials
from ._report import table

PATCH = (8, 8)
TRAINING_SPARSITY, SPARSITY = 128, 965
SWEEPS = 10
SIDE = 256
PAPER = "paper: wool 20.97 dB, corduroy 21.15 dB, pulli 21.90 dB, 4.71 MB each"


def main() -> None:
    options = arguments("sparse_own", __doc__)
    rows = [["", "SNR", "PSNR, peak 1", "PSNR, own peak", "size", "training", "coding"]]
    for name, dataset in materials(options.folder, options.only).items():
        rows.append([name, *_row(dataset)])
        print(*rows[-1], flush=True)
    print(table(rows))
    print(PAPER)


def _row(dataset: Dataset) -> list[str]:
    ensemble = train([dataset], patch=PATCH, dictionaries=1, sweeps=SWEEPS,
                     sparsity={"YUV": TRAINING_SPARSITY})  # fmt: skip
    model = code(dataset, ensemble, {"YUV": SPARSITY})
    found = measure(dataset, model)
    peak = max(float(np.max(lit)) for lit in dataset.samples)
    halves = 2 * sum(matrices.size for matrices in ensemble.dictionaries["YUV"])
    size = model.code_bytes * SIDE**2 / (dataset.shape[2] * dataset.shape[3]) + halves
    return [f"{found['snr_db']:.2f} dB", f"{-10 * np.log10(found['mse']):.2f} dB",
            f"{10 * np.log10(peak**2 / found['mse']):.2f} dB", f"{size / 2**20:.2f} MB",
            f"{ensemble.training['seconds']:.0f} s", f"{model.fit['seconds']:.0f} s"]  # fmt: skip


if __name__ == "__main__":
    main()
