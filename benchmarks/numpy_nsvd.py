"""N-SVD in straightforward numpy, to be compared with the compiled fit: whole float32 arrays and
matrix products, bases from eigenvectors of Gram matrices.

The sequentially truncated HOSVD (Vannieuwenhoven et al. 2012), and alternating least squares from
there (De Lathauwer et al. 2000), each product in the order that takes the fewest operations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._tensors import Array, leading_basis, squared_norm

Bases = list[Array]


def contract(tensor: Array, basis: Array, mode: int) -> Array:
    """A x_n U^T for a basis U (I_n, R_n), without moving axes."""
    shape = (*tensor.shape[:mode], basis.shape[1], *tensor.shape[mode + 1 :])
    rows = len(basis)
    if mode == tensor.ndim - 1:
        return (tensor.reshape(-1, rows) @ basis).reshape(shape)
    outer = int(np.prod(tensor.shape[:mode]))
    return np.matmul(basis.T, tensor.reshape(outer, rows, -1)).reshape(shape)


def gram(tensor: Array, mode: int) -> NDArray[Any]:
    """ufn(A) ufn(A)^T; the first and the last mode without moving axes."""
    rows = tensor.shape[mode]
    if mode == tensor.ndim - 1:
        unfolded = tensor.reshape(-1, rows)
        return unfolded.T @ unfolded
    unfolded = np.moveaxis(tensor, mode, 0).reshape(rows, -1)
    return unfolded @ unfolded.T


def hosvd(tensor: Array, ranks: Sequence[int]) -> tuple[Array, Bases]:
    """The sequentially truncated HOSVD: core and bases."""
    bases = []
    for mode, rank in enumerate(ranks):
        bases.append(leading_basis(gram(tensor, mode), rank))
        tensor = contract(tensor, bases[mode], mode)
    return tensor, bases


def sweep(tensor: Array, bases: Bases) -> Array:
    """One sweep of alternating least squares, mode 0 last; changes the bases, returns the core."""
    ranks = [basis.shape[1] for basis in bases]
    # From I to R rows, by falling 1/R - 1/I.
    order = sorted(range(1, tensor.ndim), key=lambda n: 1 / tensor.shape[n] - 1 / ranks[n])
    projected = contract(tensor, bases[0], 0)
    for mode in range(1, tensor.ndim):
        rest = projected
        for other in order:
            if other != mode:
                rest = contract(rest, bases[other], other)
        bases[mode] = leading_basis(gram(rest, mode), ranks[mode])
    rest = tensor
    for mode in order:
        rest = contract(rest, bases[mode], mode)
    bases[0] = leading_basis(gram(rest, 0), ranks[0])
    return contract(rest, bases[0], 0)


def error(core: Array, energy: float) -> float:
    """||A - approximation||^2 / ||A||^2 with orthonormal bases, of which `energy` is ||A||^2."""
    return 1 - squared_norm(core) / energy
