"""OpenEXR pictures of colours and spectra, in a zip whose checksums are right."""

import numpy as np
import OpenEXR

from tests.datasets.image_zips import zip_of
from tests.datasets.picture_files import exr_of

READER = "ubo2003"
SUFFIX = ".zip"


def wrap(data: bytes) -> bytes:
    """The file with one picture in it: a changed one would not pass a zip's checksum."""
    return zip_of({"tl000 pl000 tv000 pv000.exr": data})


def seeds() -> dict[str, bytes]:
    values = np.random.default_rng(0).random((5, 7, 4)).astype(np.float32)
    half = values.astype(np.float16)
    tiles = {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
    return {
        "half": exr_of(half[..., :3]),
        "float": exr_of(values[..., :3], compression=OpenEXR.NO_COMPRESSION),
        "xyz": exr_of(half[..., :3], "XYZ", compression=OpenEXR.RLE_COMPRESSION),
        "piz": exr_of(half, "RGBA", compression=OpenEXR.PIZ_COMPRESSION),
        "b44": exr_of(half[..., :3], compression=OpenEXR.B44_COMPRESSION),
        "dwa": exr_of(half[..., :3], compression=OpenEXR.DWAA_COMPRESSION),
        "tiles": exr_of(half[..., :3], **tiles),
        "grey": exr_of(half[..., :1], "Y"),
        "spectrum": exr_of(values, ("400nm", "500nm", "600nm", "700nm")),
    }
