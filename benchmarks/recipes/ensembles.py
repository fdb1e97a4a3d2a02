"""Make the ensembles that Nacre comes with, addon/ensembles.

    python -m benchmarks.recipes.ensembles FOLDER [DIRECTIONS]

DIRECTIONS are ubo81 or ubo151 (default: both). FOLDER/DIRECTIONS gets six measured materials, where
they are not there (an hour or more), and what is trained on them: eight dictionaries a part, all
patches half a patch apart.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from addon.models.sparse.files import SHIPPED

from .._sparse_sets import SETS, ensemble_path, trained

DICTIONARIES = 8


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.recipes.ensembles", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("folder", type=Path)
    parser.add_argument("directions", nargs="?", choices=SETS)
    options = parser.parse_args()
    for directions in [options.directions] if options.directions else SETS:
        folder = options.folder / directions
        ensemble = trained(DICTIONARIES, folder, directions)
        path = SHIPPED / f"{directions}.exr"
        shutil.copyfile(ensemble_path(DICTIONARIES, folder), path)
        print(f"{path.name}: {ensemble.training['patches']} patches, "
              f"{ensemble.training['seconds']:.0f} s")  # fmt: skip


if __name__ == "__main__":
    main()
