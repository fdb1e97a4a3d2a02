"""How far a model is from its dataset, in linear values."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import prod

import numpy as np
from numpy.typing import NDArray

from ..datasets.dataset import Dataset
from ..datasets.quality import compare_blocks
from ..errors import Cancelled
from .clustered_tucker import ClusteredTucker

_BLOCK = 2**23  # values that are decoded at a time
_MOST_DB = 120.0  # stands for no error at all


def measure_snr(
    dataset: Dataset,
    model: ClusteredTucker,
    progress: Callable[[float, str], bool] | None = None,
) -> float:
    """10 log10(sum A^2 / sum (A - A^)^2) in dB of decoded values; reads the samples once.

    A fit knows the error of what it fitted, which is not that of linear values where these were
    not fitted. Raises Cancelled on request.
    """

    def pairs() -> Iterator[tuple[NDArray[np.floating], NDArray[np.floating]]]:
        rows = len(dataset.samples)
        count = max(1, _BLOCK // prod(dataset.shape[1:]))
        for first in range(0, rows, count):
            if progress is not None and not progress(first / rows, "Measuring the error"):
                raise Cancelled
            part = slice(first, first + count)
            yield dataset.samples[part], model.decode(**{model.modes[0]: part})

    found = compare_blocks(pairs())["snr_db"]
    return _MOST_DB if found is None else min(found, _MOST_DB)
