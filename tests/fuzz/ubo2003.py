"""Zips of JPEG, PNG and BMP images."""

import numpy as np

from tests.datasets.image_zips import encode, zip_of

SUFFIX = ".zip"

_ANGLES = ("tl000 pl000 tv000 pv000", "tl015 pl090 tv000 pv000")


def seeds() -> dict[str, bytes]:
    pixels = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3) * 14
    return {
        kind.lower(): zip_of({f"0 {name}.{kind.lower()}": encode(pixels, kind) for name in _ANGLES})
        for kind in ("JPEG", "PNG", "BMP")
    } | {"folders": zip_of({f"a/{name}.png": encode(pixels) for name in _ANGLES} | {"b/": b""})}
