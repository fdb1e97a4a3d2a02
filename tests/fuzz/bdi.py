"""Bidirectional image files."""

import numpy as np
from bonn_files import BdiFile

READER = "btf"
SUFFIX = ".btf"


def seeds() -> dict[str, bytes]:
    mask = np.arange(9).reshape(3, 3) % 4 != 1
    return {
        "sparse": BdiFile(width=3, height=3, lines=1, mask=mask).to_bytes(),
        "full": BdiFile(width=3, height=2, compression=0, version=4).to_bytes(),
        "packed": BdiFile(width=2, height=4, compression=1, cosine_flag=0).to_bytes(),
        "none": BdiFile(width=3, height=3, mask=np.zeros((3, 3), bool)).to_bytes(),
        "spectral": BdiFile(
            version=4, channel_names=(b"400", b"700nm"), compression=1, width=2, height=2, lines=1
        ).to_bytes(),
        "turned": BdiFile(rotations=np.ones((2, 3, 3)), width=1, height=2).to_bytes(),
    }
