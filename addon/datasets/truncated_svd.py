"""The first singular vectors of a matrix that is too large to hold, from passes over its rows."""

import numpy as np

# Vectors more than are wanted, without which the last of those converge slowly.
_MORE = 10


class TruncatedSvd:
    """Factors of a matrix (rows, columns), of which each pass adds all rows in blocks.

    Subspace iteration from a random start (Halko, Martinsson and Tropp, 2011). It holds twice
    `components` columns and once as many rows, in single precision: singular values below 3e-4 of
    the largest are lost.
    """

    def __init__(self, rows: int, columns: int, components: int, seed: int = 0) -> None:
        self.components = min(components, rows, columns)
        count = min(components + _MORE, rows, columns)
        start = np.random.default_rng(seed).standard_normal((columns, count), np.float32)
        self._basis = np.linalg.qr(start)[0]
        self._next = np.zeros_like(self._basis)
        self._projected = np.empty((rows, count), np.float32)

    def add(self, rows: slice, block: np.ndarray) -> None:
        """Some rows of the matrix, (row, column) float32."""
        projected = block @ self._basis
        self._projected[rows] = projected
        self._next += block.T @ projected

    def end_pass(self) -> None:
        """After all rows but those of the last pass: look in a better subspace."""
        self._basis = np.linalg.qr(self._next)[0]
        self._next = np.zeros_like(self._basis)

    def factors(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Singular values (k,), left vectors (rows, k), right ones times values (columns, k)."""
        left, values, mixing = np.linalg.svd(self._projected, full_matrices=False)
        count = self.components
        return values[:count], left[:, :count], self._basis @ (mixing[:count].T * values[:count])
