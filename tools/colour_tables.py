"""Writes addon/datasets/cie_1931_d65.csv, which turns spectra into colours.

The CIE 1931 colour matching functions of 2 degrees and the illuminant D65, every nanometre, from
the library colour-science: `python -m tools.colour_tables`, with colour-science 0.4.7 installed.
Between the 5 nm at which D65 is tabulated it is linear, as the CIE defines it.
"""

from pathlib import Path

import numpy as np

TABLE = Path(__file__).resolve().parents[1] / "addon" / "datasets" / "cie_1931_d65.csv"


def main() -> None:
    import colour

    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    d65 = colour.SDS_ILLUMINANTS["D65"]
    wavelengths = observer.wavelengths[observer.wavelengths <= d65.wavelengths[-1]]
    illuminant = np.interp(wavelengths, d65.wavelengths, d65.values)
    rows = np.column_stack([wavelengths, observer[wavelengths], illuminant])
    lines = [",".join(f"{value:.10g}" for value in row) for row in rows]
    TABLE.write_text("\n".join(["nm,x,y,z,d65", *lines, ""]))


if __name__ == "__main__":
    main()
