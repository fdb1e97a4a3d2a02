"""An ensemble of orthonormal dictionaries, and which datasets it is for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...datasets.dataset import Dataset
from ...errors import NacreError

_SAME_DEGREES = 0.5  # directions of files differ by their rounding


@dataclass(frozen=True)
class Ensemble:
    """Dictionaries for patches of one size and one set of directions.

    patch         (height, width) in texels
    light, view   (L, 3), (V, 3) unit vectors
    dictionaries  of "Y", "U" and "V", or of "YUV" together: for each mode (K, I, I) float32, atoms
                  are columns; modes are y, x, light, view and, of "YUV", colour
    offset        of the logarithm (sparse.transform)
    by_deviation  whether images are divided by their deviation, as the authors' are
    training      how it was made: sparsity, objective of each sweep, materials ...
    """

    patch: tuple[int, int]
    light: NDArray[np.float64]
    view: NDArray[np.float64]
    dictionaries: Mapping[str, tuple[NDArray[np.float32], ...]]
    offset: float
    by_deviation: bool = False
    training: Mapping[str, Any] = field(default_factory=dict)

    def shape(self, key: str) -> tuple[int, ...]:
        """The rows of each mode of one part."""
        return tuple(matrices.shape[1] for matrices in self.dictionaries[key])

    def atoms(self, key: str) -> tuple[int, ...]:
        """The atoms of each mode of one part: as many as rows, but where rows were resampled."""
        return tuple(matrices.shape[2] for matrices in self.dictionaries[key])

    def misfit(self, other: Dataset | Ensemble) -> str:
        """Why the directions are not those of a dataset or ensemble, or "": dictionaries cannot be
        resampled."""
        for axis, own in (("light", self.light), ("view", self.view)):
            wanted = getattr(other, axis)
            if len(own) != len(wanted):
                return f"it is for {len(own)} {axis}s, not for {len(wanted)}"
            cosine = np.clip(np.sum(own * wanted, axis=1), -1.0, 1.0)
            worst = int(np.argmin(cosine))
            angle = float(np.degrees(np.arccos(cosine[worst])))
            if angle > _SAME_DEGREES:
                return f"its {axis} {worst} is {angle:.1f} degrees away"
        return ""


def choose(ensembles: Mapping[str, Ensemble], dataset: Dataset) -> Ensemble:
    """The first of some named ensembles that is for a dataset's directions.

    Raises NacreError, with the reason for each, when there is none.
    """
    reasons = []
    for name, ensemble in ensembles.items():
        reason = ensemble.misfit(dataset)
        if not reason:
            return ensemble
        reasons.append(f"{name}: {reason}")
    raise NacreError(
        f"{dataset.path.name}: no ensemble is for its directions ({'; '.join(reasons)}); train one"
    )


def orthonormal(matrices: NDArray[np.floating]) -> NDArray[np.float32]:
    """The orthonormal matrices (K, I, I) nearest to nearly orthonormal ones.

    Half floats are off by 2.5e-4; each of Newton's steps for the polar decomposition squares that.
    """
    found = np.asarray(matrices, np.float64)
    for _ in range(4):
        gram = found.transpose(0, 2, 1) @ found
        found = 1.5 * found - 0.5 * (found @ gram)
    return found.astype(np.float32)


def largest_misfit(modes: Sequence[NDArray[np.floating]]) -> float:
    """The largest entry of |U^T U - I|."""
    return max(
        float(np.abs(u.transpose(0, 2, 1) @ u - np.eye(u.shape[1])).max())
        for u in (np.asarray(matrices, np.float64) for matrices in modes)
    )
