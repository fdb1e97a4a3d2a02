"""MERL's tables, of fewer cells: real ones take 35 MB, which no fuzzer gets through.

The reader is the same but for the cells that it knows. Real sizes are in test_import_merl.py.
"""

import math
import struct
from contextlib import AbstractContextManager
from unittest.mock import patch

import numpy as np

from addon.datasets import merl

SUFFIX = ".binary"

_CELLS = {(3, 2, 4): math.pi, (3, 2, 8): 2 * math.pi}


def smaller() -> AbstractContextManager:
    return patch.dict(merl._SHAPES, _CELLS)


def seeds() -> dict[str, bytes]:
    rng = np.random.default_rng(1)
    tables = {shape: rng.uniform(-0.2, 1.0, (3, *shape)) for shape in _CELLS}
    files = {
        "x".join(map(str, shape)): struct.pack("<3i", *shape) + table.tobytes()
        for shape, table in tables.items()
    }
    return files | {"no numbers": files["3x2x4"][:12] + b"\xff" * (len(files["3x2x4"]) - 12)}
