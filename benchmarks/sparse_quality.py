"""SparseBTF on materials that were not trained on, in the form of the paper's Tables 3 to 5.

    python -m benchmarks.sparse_quality [FOLDER] [--authors FOLDER]

FOLDER holds datasets of 151 x 151 directions and 60 x 60 texels, measured where they are not there
(two hours and more; `python -m benchmarks.recipes FOLDER --directions ubo151` with the same texels
and samples does the same), and ensembles trained on six of them by K dictionaries. The paper
trained on 18 measured materials; ours are rendered, six, and noisier than a measurement.

MSE is of linear values, times 10^4. SparseBTF(N) takes at most 2 N bytes a texel for values,
positions and membership; the ensemble and the means of images are reported apart. PCA(n) is of
whole texels (all lights, views and colours), n halves each: its basis learned from the materials
that the ensemble was trained on, or from the material itself, where the basis counts to its size.
`--authors` is the folder of the authors' ensembles.
"""

from __future__ import annotations

import time
from pathlib import Path

from addon.datasets.dataset import Dataset
from addon.models.fit import compress, quality_settings
from addon.models.sparse.coding import code, measure
from addon.models.sparse.ensemble import Ensemble
from addon.models.sparse.files import load_ensemble
from addon.models.sparse.model import SparseBtf

from ._pca import Pca
from ._report import bar, table
from ._sparse_sets import QUALITIES, TRAINING, UNSEEN, datasets, error, parser, trained

DICTIONARIES = (2, 4, 8)


def main() -> None:
    arguments = parser("sparse_quality", __doc__)
    arguments.add_argument("--authors", type=Path, help="folder of the authors' ensembles")
    options = arguments.parse_args()
    learned, unseen = (datasets(names, options.folder, "ubo151") for names in (TRAINING, UNSEEN))
    for name, dataset in (learned | unseen).items():
        print(f"{name}: noise floor {dataset.noise_floor_db} dB")

    ensembles = {f"K {count}": reported(trained(count, options.folder, "ubo151"), count)
                 for count in DICTIONARIES}  # fmt: skip
    if options.authors:
        ensembles["authors'"] = load_ensemble(options.authors)
    models = {
        (label, name): coded(dataset, ensemble)
        for label, ensemble in ensembles.items()
        for name, dataset in unseen.items()
    }
    print_quality(models, unseen)
    print_sizes(models["K 8", UNSEEN[0]])
    print_pca(models, list(learned.values()), unseen)
    print_tensors(models, unseen)


def reported(ensemble: Ensemble, count: int) -> Ensemble:
    """What is printed of a training."""
    training = ensemble.training
    print(f"\n{count} dictionaries, {training['patches']} patches of {', '.join(TRAINING)}: "
          f"{training['seconds']:.0f} s")  # fmt: skip
    sweeps = max(len(errors) for errors in training["objective"].values())
    print(table([["objective", *map(str, range(1, sweeps)), "end"], *(
        [key, *(f"{error:.4f}" for error in errors)]
        for key, errors in training["objective"].items())]), flush=True)  # fmt: skip
    return ensemble


def coded(dataset: Dataset, ensemble: Ensemble) -> SparseBtf:
    """At the highest quality; the others are the first of its coefficients."""
    return code(dataset, ensemble, QUALITIES[-1])


def print_quality(models: dict[tuple[str, str], SparseBtf], unseen: dict[str, Dataset]) -> None:
    """Table 3: MSE by quality, for each ensemble."""
    rows, falls = [], True
    for (label, name), model in models.items():
        errors = [error(unseen[name], model, quality) for quality in QUALITIES]
        if label.startswith("K"):
            falls &= all(b < a for a, b in zip(errors, errors[1:], strict=False))
        rows.append([name, label, *(f"{e:.2f}" for e in errors), f"{model.fit['seconds']:.0f} s"])
    print(table([["unseen", "ensemble", *(f"SparseBTF ({q})" for q in QUALITIES), "coding"],
                 *sorted(rows)]))  # fmt: skip
    print(bar(falls, "the error falls at every step"))


def print_sizes(model: SparseBtf) -> None:
    """Table 4: sizes, of these texels and of the paper's 400 x 400, whose BTF is of halves."""
    lights, views = model.normalised.mean.shape[:2]
    means = 2 * model.normalised.mean.size
    halves = 2 * sum(own.size for modes in model.ensemble.dictionaries.values() for own in modes)
    whole = 2 * 3 * lights * views * 400 * 400
    rows = [["", "bytes a texel", "400 x 400 texels", "ratio", "with the rest", "paper"]]
    paper = dict(zip(QUALITIES, (4218, 2122, 1065, 506, 260), strict=True))
    for quality in QUALITIES:
        some = model.truncated(quality)
        texel = some.code_bytes / (model.height * model.width)
        size = texel * 400 * 400
        rows.append([f"SparseBTF ({quality})", f"{texel:.1f}", f"{size / 2**20:.2f} MB",
                     f"{whole / size:.0f}", f"{whole / (size + means + halves):.0f}",
                     str(paper[quality])])  # fmt: skip
    print(table(rows))
    print(f"the rest: ensemble {halves / 2**20:.2f} MB, means {means / 2**20:.2f} MB")


def print_pca(
    models: dict[tuple[str, str], SparseBtf], materials: list[Dataset], unseen: dict[str, Dataset]
) -> None:
    """Table 5: PCA(64), twice the size of SparseBTF(32)."""
    learned = Pca.learned(materials, 64)
    rows, holds = [], True
    for name, dataset in unseen.items():
        found = error(dataset, models["K 8", name], 32)
        against = 1e4 * learned.error(dataset)
        count = dataset.shape[2] * dataset.shape[3]
        own = Pca.learned([dataset], 64, count)
        holds &= found < against
        basis = own.columns.size * 2 / count
        rows.append([name, f"{found:.2f}", f"{against:.2f}", f"{1e4 * own.error(dataset):.2f}",
                     f"128 + {basis:.0f}"])  # fmt: skip
    print(table([["unseen", "SparseBTF (32)", "PCA (64), learned", "PCA (64), fitted to it",
                  "its bytes a texel"], *rows]))  # fmt: skip
    print(bar(holds, "SparseBTF (32) beats PCA (64) learned from the same materials"))


def print_tensors(models: dict[tuple[str, str], SparseBtf], unseen: dict[str, Dataset]) -> None:
    """Our MK-CTA fitted to the material, at equal bytes."""
    rows = []
    for name, dataset in unseen.items():
        model = models["K 8", name]
        for quality in ("DRAFT", "MEDIUM"):
            started = time.monotonic()
            fitted = compress(dataset, "mkcta", **quality_settings(dataset, "mkcta", quality))
            seconds = time.monotonic() - started
            size = 2 * (fitted.core.size + sum(own.size for own in fitted.bases.values()))
            equal = max(1, size // (2 * model.height * model.width))
            sparse = model.truncated(equal)
            rows.append([name, f"{size / 1e6:.2f} MB", f"{fitted.fit['snr_db']:.2f} dB",
                         f"{seconds:.0f} s", f"SparseBTF ({sparse.quality})",
                         f"{measure(dataset, sparse)['snr_db']:.2f} dB"])  # fmt: skip
    print(table([["unseen", "bytes", "MK-CTA, fitted to it", "", "SparseBTF of these bytes", ""],
                 *rows]))  # fmt: skip


if __name__ == "__main__":
    main()
