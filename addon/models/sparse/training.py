"""Training an ensemble on the patches of some datasets (SparseBTF, Section 3.2)."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import nacre_native
import numpy as np
from numpy.typing import NDArray

from ...datasets.dataset import Dataset
from ...errors import Cancelled, NacreError
from ..checkpoint import StateFile, samples_of
from .ensemble import Ensemble
from .patches import Origin, channels_of, overlapping, read_patches
from .subspace import Subspace
from .transform import OFFSET, OFFSETS, normalisation

SPARSITY = {"Y": 256, "U": 32, "V": 32}
"""Of the paper."""

SUBSPACE = 64
"""Columns of the subspaces that are trained in. Of 81 directions, 81, 64, 48 and 32 columns gave an
unseen material 9.98, 9.98, 9.97 and 10.03 dB."""

_ALL = 2880
"""Up to so many patches are all trained on, of more a tenth but not fewer than these: the paper has
a tenth of 28,800."""


def train(
    datasets: Sequence[Dataset],
    *,
    patch: tuple[int, int] = (8, 8),
    dictionaries: int = 8,
    sparsity: Mapping[str, int] = SPARSITY,
    sweeps: int = 30,
    tolerance: float = 1e-3,
    reassign: int = 1,
    subspace: int = SUBSPACE,
    offset: float = OFFSET,
    by_deviation: bool = False,
    seed: int = 0,
    threads: int = 0,
    folder: Path | None = None,
    state: Path | None = None,
    resume: bool = False,
    progress: Callable[[float, str], bool] | None = None,
) -> Ensemble:
    """Train the dictionaries of each part of `sparsity` on datasets of the same directions.

    sparsity   coefficients of a patch: of "Y", "U", "V", or of "YUV" with colour as a fifth mode
    reassign   choose each patch's dictionary anew in every so many sweeps: others take less time
    subspace   columns of light and of view that are trained in (sparse.subspace);
               with as many as there are lights and views nothing is left out
    offset, by_deviation  of the logarithm, and how images are normalised (sparse.transform)
    folder     where the patches lie while they are trained on, as half floats
    state      a folder that keeps the state after each sweep, removed when the training ends
    resume     go on from `state`, if it is there, to the bits of a training without a break

    Raises NacreError for datasets that do not go together, Cancelled on request.
    """
    settings = {
        "patch": list(patch),
        "dictionaries": dictionaries,
        "sparsity": dict(sparsity),
        "tolerance": tolerance,
        "reassign": reassign,
        "subspace": subspace,
        "offset": offset,
        "by_deviation": by_deviation,
        "seed": seed,
        "materials": [dataset.path.stem for dataset in datasets],
    }
    _check(datasets, patch, sparsity, offset)
    said = [settings, [samples_of(dataset) for dataset in datasets]]
    started = time.monotonic()
    chosen = _choose(datasets, patch, seed)
    if state and not resume:
        shutil.rmtree(state, ignore_errors=True)
    found, history = {}, {}
    shares = len(sparsity)
    with tempfile.TemporaryDirectory(prefix=".patches-", dir=folder) as scratch:
        report = _part_of(progress, 0.0, 0.1)
        files = _write_patches(
            datasets, chosen, patch, tuple(sparsity), offset, by_deviation, scratch, report
        )
        for number, (key, count) in enumerate(sparsity.items()):
            report = _part_of(
                progress, 0.1 + 0.9 * number / shares, 0.1 + 0.9 * (number + 1) / shares
            )
            keeper = _Keeper(state / f"{key}.npz", said) if state else None
            patches = np.load(files[key], mmap_mode="r")
            within = Subspace.of(patches, subspace)
            patches, norm = within.reduce(patches, files[key].with_suffix(".reduced.npy"))
            files[key].unlink()
            try:
                result = nacre_native.fit_ensemble(
                    patches,
                    dictionaries=dictionaries,
                    sparsity=count,
                    sweeps=sweeps,
                    tolerance=tolerance,
                    reassign=reassign,
                    seed=seed,
                    threads=threads,
                    start=keeper.load() if keeper else None,
                    checkpoint=keeper.save if keeper else None,
                    progress=report,
                )
            except nacre_native.Cancelled as stop:
                raise Cancelled from stop
            except (ValueError, MemoryError) as problem:
                raise NacreError(f"training {key}: {problem}") from problem
            found[key] = tuple(within.expand(result["dictionaries"]))
            # What the subspaces leave out is an error, too.
            inside = result["squared_norm"] / norm if norm else 0.0
            errors = (1.0 - inside * (1.0 - error) for error in result["errors"])
            history[key] = [round(error, 9) for error in errors]
    if state:
        shutil.rmtree(state, ignore_errors=True)
    return Ensemble(
        patch=patch,
        light=datasets[0].light,
        view=datasets[0].view,
        dictionaries=found,
        offset=offset,
        by_deviation=by_deviation,
        training={
            **settings,
            "patches": sum(len(origins) for origins in chosen),
            "objective": history,
            "seconds": round(time.monotonic() - started, 1),
        },
    )


class _Keeper:
    """The state of one part's training, saved after each sweep, however fast."""

    def __init__(self, path: Path, settings: Any) -> None:
        self._file = StateFile(path, settings)

    def save(self, state: Mapping[str, Any]) -> None:
        lists = ("errors", "orthonormality", "reseeded", "squared_norm", "sweeps")
        arrays = {f"mode{n}": matrices for n, matrices in enumerate(state["dictionaries"])}
        rest = {name: state[name] for name in lists}
        self._file.save({"members": state["members"], **arrays}, rest)

    def load(self) -> dict[str, Any] | None:
        found = self._file.load()
        if found is None:
            return None
        arrays, state = found
        try:
            state["members"] = arrays.pop("members")
            state["dictionaries"] = [arrays[f"mode{n}"] for n in range(len(arrays))]
        except KeyError as error:
            raise self._file.damaged() from error
        return state


def _check(
    datasets: Sequence[Dataset],
    patch: tuple[int, int],
    sparsity: Mapping[str, int],
    offset: float,
) -> None:
    if not datasets:
        raise NacreError("training needs at least one dataset")
    first = datasets[0]
    for dataset in datasets:
        if dataset.kind != "btf":
            raise NacreError(f"{dataset.path.name}: holds {dataset.kind}, which has no colours")
        reason = Ensemble(patch, first.light, first.view, {}, 0.0).misfit(dataset)
        if reason:
            raise NacreError(
                f"{dataset.path.name}: an ensemble is for one set of directions, and that of "
                f"{first.path.name} is another: {reason}"
            )
        sizes = (dataset.sizes["y"], dataset.sizes["x"])
        if min(patch) < 1 or patch[0] > sizes[0] or patch[1] > sizes[1]:
            raise NacreError(
                f"{dataset.path.name}: patches of {patch[1]} x {patch[0]} do not fit its "
                f"{sizes[1]} x {sizes[0]} texels"
            )
    if not OFFSETS[0] <= offset <= OFFSETS[1]:
        low, high = OFFSETS
        raise NacreError(f"offset {offset:g}: expected {low:g} to {high:g}")
    for key, count in sparsity.items():
        most = patch[0] * patch[1] * len(first.light) * len(first.view) * len(key)
        if not 1 <= count <= most:
            raise NacreError(f"sparsity {key}={count}: expected 1 to {most}")


def _choose(datasets: Sequence[Dataset], patch: tuple[int, int], seed: int) -> list[list[Origin]]:
    """The patches of each dataset that are trained on."""
    every = [overlapping(dataset, patch) for dataset in datasets]
    total = sum(len(origins) for origins in every)
    if total <= _ALL:
        return every
    kept = np.zeros(total, bool)
    count = max(_ALL, total // 10)
    kept[np.random.default_rng(seed).choice(total, count, replace=False)] = True
    chosen, first = [], 0
    for origins in every:
        mask = kept[first : first + len(origins)]
        chosen.append([origin for origin, keep in zip(origins, mask, strict=True) if keep])
        first += len(origins)
    return chosen


def _write_patches(
    datasets: Sequence[Dataset],
    chosen: Sequence[Sequence[Origin]],
    patch: tuple[int, int],
    keys: tuple[str, ...],
    offset: float,
    by_deviation: bool,
    scratch: str,
    progress: Callable[[float, str], bool],
) -> dict[str, Path]:
    """One file of patches for each part: too many to be in memory."""
    total = sum(len(origins) for origins in chosen)
    angles = (len(datasets[0].light), len(datasets[0].view))
    files = {key: Path(scratch, f"{key}.npy") for key in keys}
    stored: dict[str, NDArray[np.float16]] = {}
    try:
        for key, path in files.items():
            shape = (total, *patch, *angles, *((3,) if len(key) > 1 else ()))
            stored[key] = np.lib.format.open_memmap(path, "w+", np.float16, shape)
        first = 0
        for dataset, origins in zip(datasets, chosen, strict=True):
            normalised = normalisation(dataset, offset, by_deviation)
            for part, patches in read_patches(dataset, normalised, patch, origins):
                if not progress((first + part.start) / total, "Reading patches"):
                    raise Cancelled
                for key in keys:
                    place = slice(first + part.start, first + part.stop)
                    stored[key][place] = channels_of(patches, key)
            first += len(origins)
    except OSError as error:
        with suppress(OSError):
            shutil.rmtree(scratch)
        raise NacreError(f"no room for the patches: {error.strerror}") from error
    return files


def _part_of(
    progress: Callable[[float, str], bool] | None, begin: float, end: float
) -> Callable[[float, str], bool]:
    if progress is None:
        return lambda fraction, message: True
    return lambda fraction, message: progress(begin + (end - begin) * fraction, message)
