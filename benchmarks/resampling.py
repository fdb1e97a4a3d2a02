"""How well models interpolate: lights and views that were held out, against the samples there.

Some lights and views, none of the lowest, are left out of a dataset. Models are fitted to the rest
and resampled to what was left out. SNR in dB at held-out lights, at held-out views and at pairs of
both, beside what interpolation alone reaches: the nearest measured direction, and the thin-plate
spline of the samples themselves. `cost` is what few clusters add: resampled values at the pairs
against the spline of the decoded samples. The last lines are of the tables that materials read:
their error against the resampled model, at the measured and at the held-out pairs.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from addon.datasets.dataset import Dataset, DatasetWriter, open_dataset
from addon.models.clustered_tucker import ClusteredTucker
from addon.models.fit import compress, quality_settings
from addon.models.interpolation import thin_plate_weights
from addon.models.resample import resample
from addon.tables.evaluate import evaluate_patch
from addon.tables.tables import build_tables

from ._data import arguments, materials
from ._report import table

HELD_OUT = 9
METHODS = {"nsvd": "N-SVD", "kcta": "K-CTA", "mkcta": "MK-CTA"}

Samples = NDArray[np.floating]
Parts = tuple[Samples, Samples, Samples]
"""Samples at held-out lights, at held-out views and at pairs of both."""


def main() -> None:
    options = arguments("resampling", __doc__)
    for name, dataset in materials(options.folder, options.only).items():
        with tempfile.TemporaryDirectory() as folder:
            print(f"\n{name}\n{_report(dataset, Path(folder) / 'kept.nacre')}")


def _report(dataset: Dataset, path: Path) -> str:
    rng = np.random.default_rng(0)
    lights, new_lights = _split(dataset.light, rng)
    views, new_views = _split(dataset.view, rng)
    kept = _part(dataset, lights, views, path)
    light, view = dataset.light[new_lights], dataset.view[new_views]
    samples = np.asarray(dataset.samples, np.float32)
    wanted = (
        samples[new_lights][:, views],
        samples[lights][:, new_views],
        samples[new_lights][:, new_views],
    )
    measured = samples[lights][:, views]
    near = [np.argmax(new @ old.T, 1) for new, old in ((light, kept.light), (view, kept.view))]
    nearest = measured[near[0]], measured[:, near[1]], measured[near[0]][:, near[1]]
    spline = _spline(kept, measured, light, view)
    rows = [["", "fit", "light", "view", "both", "cost"]]
    rows += [["nearest", "", *_snrs(wanted, nearest)], ["spline", "", *_snrs(wanted, spline)]]
    errors = []
    for method, label in METHODS.items():
        model = compress(kept, method, **quality_settings(kept, method, "MEDIUM"))
        decoded = model.decode()
        seen = _resampled(model, light, view)
        exact = _spline(kept, decoded, light, view)
        fit, cost = _snr(measured, decoded), _snr(exact[2], seen[2])
        rows.append([label, f"{fit:.2f}", *_snrs(wanted, seen), f"{cost:.1f}"])
        if not set(model.clusters) - {"view"}:
            tables = build_tables(model)
            pairs = (
                (evaluate_patch(tables, kept.light, kept.view), decoded),
                (evaluate_patch(tables, light, view), seen[2]),
            )
            found = [_relative(values, np.maximum(of_model, 0.0)) for values, of_model in pairs]
            errors.append(
                f"tables of {label}: {found[0]:.2%} of the mean at measured directions, "
                f"{found[1]:.2%} between"
            )
    return "\n".join([table(rows), *errors])


def _split(
    directions: NDArray[np.floating], rng: np.random.Generator
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Directions kept and held out: nothing is said of those beyond the lowest that are kept."""
    inside = np.flatnonzero(directions[:, 2] > directions[:, 2].min() + 1e-3)
    out = np.sort(rng.permutation(inside)[:HELD_OUT])
    return np.setdiff1d(np.arange(len(directions)), out), out


def _part(dataset: Dataset, lights: NDArray, views: NDArray, path: Path) -> Dataset:
    """The dataset of some lights and views."""
    samples = dataset.samples
    description = {
        "nacre": 1,
        "kind": "btf",
        "axes": list(dataset.axes),
        "light": dataset.light[lights].tolist(),
        "view": dataset.view[views].tolist(),
        "channels": list(dataset.channels),
        "patch_size": list(dataset.patch_size),
        "periodic": dataset.periodic,
        "noise_floor_db": dataset.noise_floor_db,
        "source": dataset.source,
    }
    shape = (len(lights), len(views), *dataset.shape[2:])
    with DatasetWriter(path, description, shape, samples.dtype) as writer:
        for light in lights:
            writer.write(samples[light][views])
    return open_dataset(path)


def _spline(kept: Dataset, samples: Samples, light: NDArray, view: NDArray) -> Parts:
    """Samples at the kept directions, interpolated."""
    of_light = thin_plate_weights(kept.light, light).astype(np.float32)
    of_view = thin_plate_weights(kept.view, view).astype(np.float32)
    lights = np.tensordot(of_light, samples, (1, 0))
    views = np.moveaxis(np.tensordot(of_view, samples, (1, 1)), 0, 1)
    return lights, views, np.moveaxis(np.tensordot(of_view, lights, (1, 1)), 0, 1)


def _resampled(model: ClusteredTucker, light: NDArray, view: NDArray) -> Parts:
    return (
        resample(model, lights=light).decode(),
        resample(model, views=view).decode(),
        resample(model, light, view).decode(),
    )


def _snrs(wanted: Parts, seen: Parts) -> list[str]:
    return [f"{_snr(a, b):.2f}" for a, b in zip(wanted, seen, strict=True)]


def _snr(wanted: Samples, seen: Samples) -> float:
    error = np.sum(np.square(wanted - seen), dtype=float)
    return float(10.0 * np.log10(np.sum(np.square(wanted), dtype=float) / error))


def _relative(seen: Samples, wanted: Samples) -> float:
    """The mean absolute error over the mean value."""
    return float(np.abs(seen - wanted).mean(dtype=float) / wanted.mean(dtype=float))


if __name__ == "__main__":
    main()
