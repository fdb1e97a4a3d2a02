"""From a fit that is a little too good to a target: rounding makes up the difference.

A fit's quality and size come in steps, of a rank or a cluster. Rounding is continuous: it spends
what a fit has above its target on a smaller file. Quality and size are those of a saved file.
"""

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Iterator
from math import exp, log
from pathlib import Path

from ..datasets.dataset import Dataset
from ..errors import Cancelled
from .clustered_tucker import ClusteredTucker
from .exr import load_model, save_model
from .precision import SHARE, round_model
from .snr import measure_snr
from .steps import Progress, Steps

USUAL = 0.04
"""What rounding adds to the squared error, as a share of it, where the file of a given quality is
smallest: less costs bits, more costs the ranks that make up for it. Half or twice costs 2 %."""
MOST = 1.0
"""No more is added, also where a target is far below the smallest fit: 3 dB."""

_FARTHEST = 4.0 * MOST  # what round_model may be asked for, which it does not always add
_TINY = 1e-30
_NEAR_DB = 0.02
_NEAR_BYTES = 0.01
_TRIES = 6
_STEEPNESS = 10.0  # files shrink by a tenth where the share trebles, about
_JUMP = 5.0  # of the share's logarithm, from one try to the next


def size_at(share: float) -> float:
    """About how large a file is if rounding adds a share, over its size at the usual one."""
    return (USUAL / share) ** (1.0 / _STEEPNESS)


def share_at(size: float) -> float:
    """About what share makes a file so large, over its size at the usual one."""
    return USUAL * (1.0 / size) ** _STEEPNESS


def land_on_quality(
    model: ClusteredTucker,
    squared_error: float,
    fit_db: float,
    target_db: float,
    dataset: Dataset,
    folder: Path,
    progress: Progress,
) -> tuple[ClusteredTucker, float] | None:
    """Round a model as far as a target allows: the model and its measured quality in dB.

    `squared_error` and `fit_db` are the model's, sum (A - A^)^2 and the same in dB. The quality is
    at most a little above the target where MOST reaches so far, and never below; None where the
    model is not good enough. Raises Cancelled on request.
    """
    wanted = min(10.0 ** ((fit_db - target_db - _NEAR_DB / 2.0) / 10.0) - 1.0, MOST)
    share, best = wanted, None
    low, high = SHARE, _FARTHEST  # low reaches the target, high may not
    last: tuple[float, float] | None = None
    steps = Steps(progress)
    for number in range(_TRIES):
        share = min(max(share, SHARE), _FARTHEST)
        rounded = round_model(model, squared_error, share)
        reached = quality(rounded, dataset, folder, steps.step(max(3 - number, 1)))
        if reached >= target_db and (best is None or reached < best[1]):
            best = rounded, reached
        if target_db <= reached <= target_db + _NEAR_DB:
            break
        added = 10.0 ** ((fit_db - reached) / 10.0) - 1.0
        if reached >= target_db and (added > 0.9 * MOST or share == _FARTHEST):
            break
        if reached < target_db and share == SHARE:
            break
        # Where most numbers are smaller than a step, rounding adds less than round_model expects.
        growth = 1.0
        if last is not None and share != last[0] and added > last[1] > 0.0:
            growth = min(max(log(added / last[1]) / log(share / last[0]), 0.25), 4.0)
        last = share, added
        low, high = (share, high) if reached >= target_db else (low, share)
        share *= min(max(wanted / max(added, _TINY), 0.1), 10.0) ** (1.0 / growth)
        if number > 0 and not low < share < high:
            share = (low * high) ** 0.5
    return best


def land_on_bytes(
    model: ClusteredTucker,
    squared_error: float,
    limit: int,
    dataset: Dataset,
    folder: Path,
    progress: Progress,
) -> tuple[ClusteredTucker, float] | None:
    """Round a model until its file has at most `limit` bytes: the model and its quality in dB.

    The file has few bytes less where rounding can make up for them; None where MOST does not
    suffice. Raises Cancelled on request.
    """
    low, high = SHARE, MOST  # low gives too large a file, high one that is small enough
    share, steepness = USUAL, _STEEPNESS
    best, most = None, 0
    last: tuple[float, int] | None = None
    for number in range(_TRIES):
        if not progress(0.5 * number / _TRIES, "Rounding"):
            raise Cancelled
        rounded = round_model(model, squared_error, share)
        size = saved_bytes(rounded, folder)
        if most < size <= limit:
            best, most = rounded, size
        if limit * (1.0 - _NEAR_BYTES) <= size <= limit:
            break
        if last is not None and size != last[1]:  # the description of small files does not shrink
            steepness = max(log(share / last[0]) / log(last[1] / size), _STEEPNESS / 4.0)
        last = share, size
        low, high = (low, share) if size <= limit else (share, high)
        excess = log(size / (limit * (1.0 - _NEAR_BYTES / 2.0)))
        share *= exp(min(max(steepness * excess, -_JUMP), _JUMP))
        if not low < share < high:
            share = (low * high) ** 0.5
    if best is None:
        return None
    return best, quality(best, dataset, folder, lambda f, text: progress(0.5 + 0.5 * f, text))


def quality(model: ClusteredTucker, dataset: Dataset, folder: Path, progress: Progress) -> float:
    """The quality in dB of what a model's file holds. Raises Cancelled on request."""
    with _saved(model, folder) as path:
        stored = load_model(path)
    return measure_snr(dataset, stored, progress)


def saved_bytes(model: ClusteredTucker, folder: Path) -> int:
    """The size of a model's file."""
    with _saved(model, folder) as path:
        return path.stat().st_size


@contextlib.contextmanager
def _saved(model: ClusteredTucker, folder: Path) -> Iterator[Path]:
    """A model's file for as long as it is looked at, on the disk where it will be."""
    path = folder / f".target-{secrets.token_hex(4)}.exr"
    try:
        save_model(model, path)
        yield path
    finally:
        path.unlink(missing_ok=True)
