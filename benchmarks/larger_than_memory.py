"""A fit of ten times the memory it may take, killed twice and resumed, against one left alone.

`python -m benchmarks.larger_than_memory [FOLDER] [--only NAME] [--place FOLDER]`: the glossiest
material there is, tiled to 81x81x512x512 RGB half floats (10.3 GB, written once to --place), is
compressed on the command line with --memory 2. Bars: no more than 2 GB anonymous memory at any
time, and the same numbers from both. Without --place, or where the disk has no room, it is skipped.
"""

from __future__ import annotations

import argparse
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from addon.datasets.dataset import Dataset, DatasetWriter, open_dataset
from addon.models.clustered_tucker import ClusteredTucker
from addon.models.exr import load_model

from ._child import anonymous
from ._data import ROOT, arguments, glossiest, materials
from ._report import bar

TEXELS = 512
GIGABYTES = 2
POLL = 0.01
KILLS = (1, 4)
"""After how many saved states each run is killed: with the global bases alone, then iterating."""
FITS = {
    "K-CTA": "--method kcta --ranks light=20,view=4,y=32,x=32 --clusters view=8 --mixtures view=3",
    "MK-CTA": "--method mkcta --ranks light=4,view=4,y=64,x=64 --clusters light=8,view=12 "
    "--mixtures light=3,view=3",
}


def main() -> None:
    options = arguments("larger_than_memory", __doc__, _more)
    found = materials(options.folder, options.only)
    name = glossiest(found)
    if options.place is None:
        print("skipped: give --place FOLDER, where 11 GB will be written")
        return
    options.place.mkdir(parents=True, exist_ok=True)
    dataset = tiled(found[name], options.place / f"{name}{TEXELS}.nacre")
    if dataset is None:
        return
    print(f"{name}, {'x'.join(map(str, dataset.shape))} half floats, {size(dataset):.1f} GB")
    for method in options.methods:
        compare(dataset, method, options.place)


def _more(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--place", type=Path, help="where the large dataset is kept")
    parser.add_argument("--methods", nargs="+", choices=FITS, default=list(FITS))


def size(dataset: Dataset) -> float:
    """Gigabytes of the samples."""
    return float(dataset.samples.nbytes) / 1e9


def tiled(source: Dataset, path: Path) -> Dataset | None:
    """The dataset repeated along y and x; None, after saying so, where it has no room."""
    if path.is_dir():
        return open_dataset(path)
    lights, views, height, width, channels = source.shape
    shape = (lights, views, TEXELS, TEXELS, channels)
    needed = 2 * int(np.prod(shape, dtype=np.int64))
    if shutil.disk_usage(path.parent).free < 1.5 * needed:
        print(f"skipped: {path.parent} has no room for {1.5 * needed / 1e9:.0f} GB")
        return None
    description = {
        "nacre": 1,
        "kind": "btf",
        "axes": ["light", "view", "y", "x", "channel"],
        "light": source.light.tolist(),
        "view": source.view.tolist(),
        "channels": list(source.channels),
        "patch_size": [side * TEXELS / width for side in source.patch_size],
        "periodic": source.periodic,
        "noise_floor_db": source.noise_floor_db,
        "source": source.source,
    }
    repeats = (1, TEXELS // height, TEXELS // width, 1)
    with DatasetWriter(path, description, shape, np.float16) as writer:
        for light in range(lights):
            writer.write(np.tile(source.samples[light], repeats))
    return open_dataset(path)


@dataclass
class Run:
    """One process: how it ended, its seconds, its largest anonymous memory."""

    code: int
    seconds: float
    peak: int
    errors: str


def compare(dataset: Dataset, method: str, place: Path) -> None:
    whole, parts = place / "whole.exr", place / "parts.exr"
    run = compress(dataset, method, whole)
    model = load_model(whole)
    fit = model.fit
    print(
        f"\n{method}: {FITS[method]}\n  {run.seconds:.0f} s, {fit['iterations']} iterations, "
        f"{fit['passes']} passes over the samples, {fit['snr_db']:.2f} dB, "
        f"{1e-6 * whole.stat().st_size:.1f} MB"
    )
    runs = [run]
    for number, kill in enumerate(KILLS):
        runs.append(compress(dataset, method, parts, resume=number > 0, kill=kill))
        print(f"  killed after {runs[-1].seconds:.0f} s")
    runs.append(compress(dataset, method, parts, resume=True))
    print(f"  resumed and ended after {runs[-1].seconds:.0f} s more")
    peak = max(run.peak for run in runs)
    text = f"{peak / 1e9:.2f} GB anonymous memory at most, of {GIGABYTES} GB allowed"
    print(bar(peak <= GIGABYTES * 1e9, text))
    print(bar(same(model, load_model(parts)), "the same numbers when killed twice and resumed"))
    assert not list(place.glob(".*.fit*")), "a state was left behind"


def compress(
    dataset: Dataset, method: str, path: Path, *, resume: bool = False, kill: int = 0
) -> Run:
    """Compress in a process of its own, and kill it when it has saved so many states."""
    command = [sys.executable, "-m", "addon", "compress", dataset.path, path, *FITS[method].split()]
    command += ["--memory", str(GIGABYTES), *(["--resume"] if resume else [])]
    state = path.with_name(f".{path.name}.fit")
    started, peak, saved, last = time.monotonic(), 0, 0, _changed(state)
    process = subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    while process.poll() is None:
        peak = max(peak, anonymous(process.pid))
        if _changed(state) != last and state.exists():
            last = _changed(state)
            saved += 1
        if kill and saved == kill:
            process.send_signal(signal.SIGKILL)
        time.sleep(POLL)
    assert process.stderr is not None
    run = Run(process.wait(), time.monotonic() - started, peak, process.stderr.read())
    if run.code != (-signal.SIGKILL if kill else 0):
        raise SystemExit(f"{method}: ended with {run.code}: {run.errors}")
    return run


def _changed(path: Path) -> int:
    return path.stat().st_mtime_ns if path.exists() else 0


def same(a: ClusteredTucker, b: ClusteredTucker) -> bool:
    """Whether every number of two models is the same."""
    pairs = [(a.core, b.core)]
    pairs += [(a.bases[mode], b.bases[mode]) for mode in a.bases]
    pairs += [(a.members[mode], b.members[mode]) for mode in a.members]
    return a.fit["errors"] == b.fit["errors"] and all(np.array_equal(*pair) for pair in pairs)


if __name__ == "__main__":
    main()
