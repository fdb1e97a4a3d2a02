"""Radiance pictures, in a zip whose checksums are right."""

import numpy as np

from tests.datasets.image_zips import zip_of
from tests.datasets.picture_files import hdr, rgbe

READER = "ubo2003"
SUFFIX = ".zip"


def wrap(data: bytes) -> bytes:
    """The file with one picture in it: a changed one would not pass a zip's checksum."""
    return zip_of({"tl000 pl000 tv000 pv000.hdr": data})


def seeds() -> dict[str, bytes]:
    values = np.random.default_rng(0).lognormal(0, 2, (3, 9, 3))
    values[1] = values[1, 0]
    pixels = rgbe(values)
    start = b"#?RGBE\n\n-Y 1 +X 9\n"
    return {
        "runs": hdr(pixels),
        "flat": hdr(pixels, runs=False),
        "narrow": hdr(pixels[:, :5], "+Y 3 +X 5", "EXPOSURE=2\nCOLORCORR=1 2 3\n", runs=False),
        "atrium": hdr(pixels, "+X 9 -Y 3"),
        "repeats": start + b"\x09\x08\x07\x80" + b"\1\1\1\x08",
        "xyz": hdr(pixels).replace(b"rgbe", b"xyze"),
    }
