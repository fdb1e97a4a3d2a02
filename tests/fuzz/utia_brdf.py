"""UTIA's BRDFs at fewer directions: real ones take 2 MB.

The reader is the same but for the shape of its table. Real sizes are in test_import_utia_brdf.py.
"""

import math
from contextlib import AbstractContextManager
from unittest.mock import patch

import numpy as np

from addon.datasets import utia_brdf

READER = utia_brdf.FORMAT
SUFFIX = ".bin"

_SHAPE = (3, 2, 4, 2, 4)


def smaller() -> AbstractContextManager:
    return patch.object(utia_brdf, "_SHAPE", _SHAPE)


def seeds() -> dict[str, bytes]:
    rng = np.random.default_rng(1)
    return {
        "usual": rng.uniform(0.0, 1.0, _SHAPE).tobytes(),
        "negative": rng.uniform(-1.0, 0.5, _SHAPE).tobytes(),
        "large": np.full(math.prod(_SHAPE), 1e6).tobytes(),
    }
