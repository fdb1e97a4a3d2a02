"""The BTFs that benchmarks run on: the samples, and whatever rendered ones a folder holds.

`python -m benchmarks.recipes FOLDER` renders such a folder. A program of this package takes it as
its argument, or from the environment variable NACRE_BENCH_DATA.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from pathlib import Path

from addon.datasets.dataset import Dataset, open_dataset
from addon.datasets.importing import import_dataset

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "out" / "bench"
"""Where plots and pictures go."""

GLOSSY = ("studs", "lacquer", "weave")
"""Sharp, glossy materials, the sharpest first."""


def arguments(
    program: str, text: str | None, more: Callable[[argparse.ArgumentParser], None] | None = None
) -> argparse.Namespace:
    """The command line of a benchmark over materials: .folder, .only, and what `more` adds."""
    parser = argparse.ArgumentParser(prog=f"python -m benchmarks.{program}", description=text)
    given = os.environ.get("NACRE_BENCH_DATA")
    parser.add_argument(
        "folder",
        nargs="?",
        type=Path,
        default=Path(given) if given else None,
        help="with rendered datasets, NAME.nacre (default: NACRE_BENCH_DATA)",
    )
    parser.add_argument("--only", nargs="+", metavar="NAME", help="of all the materials")
    if more:
        more(parser)
    return parser.parse_args()


def materials(folder: Path | None, only: list[str] | None = None) -> dict[str, Dataset]:
    """Datasets by name: the wool, the weave where the shared data are, and those in `folder`."""
    found = {}
    shared = Path(os.environ.get("NACRE_SHARED_DATA") or ROOT.parent / "shared" / "data")
    for name in ("wool", "weave"):
        for place in (ROOT / "samples", shared / "btf"):
            source = place / f"{name}_W64xH64_L81xV81.btf"
            if source.is_file() and name not in found and (not only or name in only):
                found[name] = _imported(source, OUT / f"{name}.nacre")
    for path in sorted(folder.glob("[!.]*.nacre")) if folder else []:
        if not only or path.stem in only:
            found[path.stem] = open_dataset(path)
    missing = set(only or ()) - found.keys()
    if missing:
        raise SystemExit(f"no dataset of the name {', '.join(sorted(missing))}")
    return found


def glossiest(found: dict[str, Dataset]) -> str:
    """The name of the material whose highlights are sharpest."""
    return next((name for name in GLOSSY if name in found), next(iter(found)))


def _imported(source: Path, path: Path) -> Dataset:
    if path.is_dir():
        return open_dataset(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    return import_dataset(source, path)
