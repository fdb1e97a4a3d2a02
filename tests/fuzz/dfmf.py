"""Files of the decorrelated full matrix factorisation."""

from typing import Any

import numpy as np
from btf_writer import BtfFile

from addon.datasets.bonn.colour_models import NAMES

READER = "btf"
SUFFIX = ".btf"
SPECTRUM = (b"400", b"500nm", b"600", b"700")


def seeds() -> dict[str, bytes]:
    return {
        "usual": BtfFile(width=3, height=3).to_bytes(),
        "half": BtfFile(version=4, colour_model=11, scalars=(2, 2, 2), width=2).to_bytes(),
        "transposed": BtfFile(
            version=3, xml=b"", transposed=True, colour_model=12, scalars=(8, 4, 2)
        ).to_bytes(),
        "old": BtfFile(signature=b"!DFMF08FC", version=1, colour_model=9).to_bytes(),
        "flag": BtfFile(cosine_flag=0, pixels_per_mm=0, rotations=np.ones((1, 3, 3))).to_bytes(),
        "bgr": BtfFile(version=4, channel_names=(b"B", b"G", b"R"), width=1).to_bytes(),
        **{f"model{model}": small(colour_model=model) for model in NAMES},
        **{
            f"spectral{model}": small(
                colour_model=model, channel_names=SPECTRUM, scalars=(2,) * 4, components=(1,) * 4
            )
            for model in (0, 5, 6)
        },
    }


def small(**changes: Any) -> bytes:
    return BtfFile(version=4, xml=b"", width=2, height=2, **changes).to_bytes()
