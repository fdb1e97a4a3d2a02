"""Training in the subspaces of light and view that hold nearly all of what is coded.

Dictionaries of a patch's leading directions are small: with 64 of 151 rows for light and view a
projection takes a twelfth of the operations. The directions outside follow as they are after the
trained ones, so that dictionaries stay whole and orthonormal; docs/sparse.md has what that loses.
As the projection of a patch on orthonormal columns leaves the rest of its norm as it is, the
objective (Eq. 2a) falls by as much as that of the projected patches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .ensemble import orthonormal

_MODES = (3, 4)  # light and view of patches (n, y, x, light, view, ...)
_READ = 64  # patches that the subspaces are found from


@dataclass(frozen=True)
class Subspace:
    """Eigenvectors of all patches' Gram matrices, the largest first: light (L, L) and view (V, V)
    float32, of which `rank` columns, at most, are trained in."""

    light: NDArray[np.float32]
    view: NDArray[np.float32]
    rank: int

    @classmethod
    def of(cls, patches: NDArray[np.float16], rank: int) -> Subspace:
        """Of patches (n, y, x, light, view, ...), from some that are spread over all."""
        some = patches[np.unique(np.linspace(0, len(patches) - 1, _READ).astype(int))]
        found = []
        for axis in _MODES:
            size = patches.shape[axis]
            gram = np.zeros((size, size))
            for patch in some:
                rows = np.moveaxis(patch, axis - 1, 0).reshape(size, -1).astype(np.float32)
                gram += rows @ rows.T
            found.append(np.linalg.eigh(gram)[1][:, ::-1].astype(np.float32))
        return cls(found[0], found[1], rank)

    @property
    def columns(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The leading columns of both."""
        return self.light[:, : self.rank], self.view[:, : self.rank]

    def reduce(self, patches: NDArray[np.float16], path: Path) -> tuple[NDArray[np.float16], float]:
        """The patches in the subspaces, in a file, and the squared norm of those given."""
        light, view = self.columns
        shape = (*patches.shape[:3], light.shape[1], view.shape[1], *patches.shape[5:])
        reduced = np.lib.format.open_memmap(path, "w+", np.float16, shape)
        norm = 0.0
        for number, patch in enumerate(patches):
            values = patch.astype(np.float32)
            norm += float(np.vdot(values, values))
            values = np.moveaxis(np.tensordot(values, light, (2, 0)), -1, 2)
            values = np.moveaxis(np.tensordot(values, view, (3, 0)), -1, 3)
            reduced[number] = values
        return reduced, norm

    def expand(self, dictionaries: Sequence[NDArray[np.floating]]) -> list[NDArray[np.float32]]:
        """Whole dictionaries (K, I, I) of each mode from those of reduced patches."""
        y, x, light, view, *rest = dictionaries
        whole = []
        for trained, vectors in ((light, self.light), (view, self.view)):
            inside, outside = np.split(vectors, [trained.shape[1]], axis=1)
            others = np.broadcast_to(outside, (len(trained), *outside.shape))
            columns = orthonormal(np.concatenate([inside @ trained, others], 2))
            whole.append(columns)
        return [y, x, *whole, *rest]
