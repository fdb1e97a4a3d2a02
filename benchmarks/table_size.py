"""How far tables of several sizes are from the model they were made of, on the measured grid.

Error is the mean absolute difference over the mean value; memory that of the direction maps.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from addon.datasets.importing import import_dataset
from addon.models.fit import compress, quality_settings
from addon.tables.against_model import tables_against_model
from addon.tables.tables import build_tables

SAMPLE = Path(__file__).parent.parent / "samples" / "wool_W64xH64_L81xV81.btf"
SIZES = (64, 128, 256, 512, 1024)


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        dataset = import_dataset(SAMPLE, Path(folder) / "wool.nacre")
        model = compress(dataset, "kcta", **quality_settings(dataset, "kcta", "MEDIUM"))
        print(f"{'texels':>8} {'error':>8} {'largest':>8} {'maps':>9}")
        for size in SIZES:
            tables = build_tables(model, size)
            found = tables_against_model(model, tables)
            memory = tables.light.nbytes + tables.view.nbytes + tables.view_index.nbytes
            print(
                f"{size:>5}^2  {found['relative']:>7.2%} {found['max_abs']:>8.3f} "
                f"{memory / 1e6:>6.1f} MB"
            )


if __name__ == "__main__":
    main()
