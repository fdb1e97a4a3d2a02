"""Sparse tensor decomposition of a BTF (Ruiters and Klein 2009), to compare the tensor models with.

    A  ~  D  x_1  S_view  x_3  S_position

K-SVD (Aharon et al. 2006) splits the (light rows, view, position) tensor along its positions into a
dictionary of D_2 view-light slices and k_2 coefficients a texel; K-SVD again splits that dictionary
into a small one of D_1 light vectors and k_1 coefficients for each view of each slice. What is left
is one dense dictionary and two sparse tensors, an index and a value an entry.

Sparse codes come from batch orthogonal matching pursuit; an atom is updated by one power iteration
in place of an SVD (Rubinstein et al. 2008). Both need only inner products of the signals, so long
signals are first rotated into as few coordinates as there are signals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


@dataclass(frozen=True)
class Codes:
    """Sparse coefficients of signals: index (signals, k) of the atoms, value (signals, k)."""

    index: NDArray[np.intp]
    value: Array

    def dense(self, atoms: int) -> Array:
        """The same as a matrix (signals, atoms)."""
        whole = np.zeros((len(self.index), atoms), self.value.dtype)
        np.put_along_axis(whole, self.index, self.value, axis=1)
        return whole


@dataclass(frozen=True)
class SparseTensor:
    """A (light rows, view, position) tensor as one dictionary and two sparse tensors.

    dictionary  (D_1, rows)
    view        codes of each (view, slice), view * D_2 + slice, k_1 entries
    position    codes of each position, k_2 entries
    """

    dictionary: Array
    view: Codes
    position: Codes
    slices: int

    def decode(self) -> Array:
        """The tensor, (positions, rows * views), rows slowest."""
        return self.position.dense(self.slices) @ self.slice_dictionary()

    def slice_dictionary(self) -> Array:
        """The D_2 view-light slices, (D_2, rows * views)."""
        return _slices(self.dictionary, self.view, self.slices)

    def half(self) -> SparseTensor:
        """Every number rounded to a half float, as it is stored; slices have their own scale."""

        def rounded(values: Array) -> Array:
            return values.astype(np.float16).astype(values.dtype)

        return SparseTensor(
            rounded(self.dictionary),
            Codes(self.view.index, rounded(self.view.value)),
            Codes(self.position.index, rounded(self.position.value)),
            self.slices,
        )

    @property
    def bytes(self) -> int:
        """Half floats, and indices of one byte (two above 256 atoms)."""
        return sparse_tensor_bytes(
            rows=self.dictionary.shape[1],
            views=len(self.view.index) // self.slices,
            positions=len(self.position.index),
            atoms=(len(self.dictionary), self.slices),
            sparsity=(self.view.index.shape[1], self.position.index.shape[1]),
        )


def sparse_tensor_bytes(
    rows: int, views: int, positions: int, atoms: tuple[int, int], sparsity: tuple[int, int]
) -> int:
    """What a decomposition of these sizes takes, before it is fitted."""
    entry = [2 + (1 if count <= 256 else 2) for count in atoms]
    return (
        2 * rows * atoms[0]
        + views * atoms[1] * sparsity[0] * entry[0]
        + positions * sparsity[1] * entry[1]
    )


def fit_sparse_tensor(
    signals: Array,
    rows: int,
    *,
    atoms: tuple[int, int],
    sparsity: tuple[int, int],
    iterations: int = 10,
    training: int = 4096,
    seed: int = 0,
) -> SparseTensor:
    """Decompose signals (positions, rows * views), the position unfolding of the tensor.

    atoms      (D_1, D_2) light vectors and view-light slices
    sparsity   (k_1, k_2) coefficients for each view of each slice, and for each position
    iterations of K-SVD, each mode
    training   at most so many positions, and later light vectors, shape a dictionary, drawn at
               random; all are coded

    The codes of the positions are found anew once the slices have been approximated: the paper
    does not, and it is in its favour.
    """
    generator = np.random.default_rng(seed)
    chosen = _some(signals, training, generator)
    codes = k_svd(rotated(chosen), atoms[1], sparsity[1], iterations, generator)[1]
    usage = codes.dense(atoms[1])
    # Slices as large as their use, so that the second mode spends its error where it shows least.
    slices = best_dictionary(usage, chosen) * np.linalg.norm(usage, axis=0)[:, None]
    vectors = slices.reshape(atoms[1], rows, -1).transpose(2, 0, 1).reshape(-1, rows)
    chosen = _some(vectors, training, generator)
    dictionary = k_svd(chosen, atoms[0], sparsity[0], iterations, generator)[0]
    view = sparse_codes(dictionary, vectors, sparsity[0])
    # Each slice gets the largest value 1 in its codes, for the sake of half floats.
    grid = np.abs(view.value).reshape(-1, atoms[1], sparsity[0])
    scale = np.maximum(grid.max(axis=(0, 2)), np.finfo(grid.dtype).tiny)
    view = Codes(view.index, view.value / np.tile(scale, len(grid))[:, None])
    position = sparse_codes(_slices(dictionary, view, atoms[1]), signals, sparsity[1])
    return SparseTensor(dictionary, view, position, atoms[1])


def _some(signals: Array, count: int, generator: np.random.Generator) -> Array:
    if len(signals) <= count:
        return signals
    return signals[np.sort(generator.choice(len(signals), count, replace=False))]


def _slices(dictionary: Array, view: Codes, slices: int) -> Array:
    atoms, rows = dictionary.shape
    vectors = view.dense(atoms) @ dictionary
    return vectors.reshape(-1, slices, rows).transpose(1, 2, 0).reshape(slices, -1)


def k_svd(
    signals: Array, atoms: int, sparsity: int, iterations: int, generator: np.random.Generator
) -> tuple[Array, Codes]:
    """A dictionary (atoms, n) of unit rows, and codes of the signals (count, n) in it."""
    norms = np.linalg.norm(signals, axis=1)
    lit = np.flatnonzero(norms > 0)
    if len(lit) == 0:
        lit = np.arange(len(signals))
    first = generator.choice(lit, atoms, replace=len(lit) < atoms)
    dictionary = _unit(signals[first])
    for _ in range(iterations):
        codes = sparse_codes(dictionary, signals, sparsity).dense(atoms)
        _update_atoms(dictionary, codes, signals)
    return dictionary, sparse_codes(dictionary, signals, sparsity)


def _update_atoms(dictionary: Array, codes: Array, signals: Array) -> None:
    """One K-SVD sweep, in place: each atom and its coefficients fit what the others leave over."""
    unused = []
    for atom in range(len(dictionary)):
        users = np.flatnonzero(codes[:, atom])
        if len(users) == 0:
            unused.append(atom)
            continue
        own, others = codes[users, atom], codes[users]
        others[:, atom] = 0.0
        left = own @ signals[users] - (own @ others) @ dictionary
        dictionary[atom] = _unit(left)
        codes[users, atom] = signals[users] @ dictionary[atom] - others @ (
            dictionary @ dictionary[atom]
        )
    if unused:  # start again from the signals that are represented worst
        error = np.square(signals - codes @ dictionary).sum(axis=1)
        worst = np.argsort(-error, kind="stable")[: len(unused)]
        dictionary[unused[: len(worst)]] = _unit(signals[worst])


def sparse_codes(dictionary: Array, signals: Array, sparsity: int, block: int = 1024) -> Codes:
    """Orthogonal matching pursuit of every signal, in blocks; atoms may have any length."""
    lengths = np.maximum(np.linalg.norm(dictionary, axis=1), np.finfo(dictionary.dtype).tiny)
    unit = dictionary / lengths[:, None]
    gram = unit @ unit.T
    parts = [
        matching_pursuit(gram, signals[start : start + block] @ unit.T, sparsity)
        for start in range(0, len(signals), block)
    ]
    index = np.concatenate([part.index for part in parts])
    value = np.concatenate([part.value for part in parts])
    return Codes(index, value / lengths[index])


def matching_pursuit(gram: Array, correlations: Array, sparsity: int) -> Codes:
    """Batch orthogonal matching pursuit for unit atoms.

    gram (atoms, atoms) their inner products; correlations (count, atoms) those with the signals.
    The chosen atoms of a signal are made orthonormal one after the other. Of each orthonormal
    vector only its inner products with all atoms are kept: they say all that later steps need.
    """
    count, atoms = correlations.shape
    sparsity = min(sparsity, atoms)
    every = np.arange(count)
    left = correlations.copy()  # inner products of the atoms with what is left of the signals
    index = np.zeros((count, sparsity), np.intp)
    weight = np.zeros((count, sparsity), left.dtype)  # of the orthonormal vectors
    inner = np.zeros((count, sparsity, atoms), left.dtype)
    taken = np.zeros((count, atoms), bool)
    triangle = np.zeros((count, sparsity, sparsity), left.dtype)  # chosen atoms in those vectors
    for step in range(sparsity):
        best = np.argmax(np.where(taken, -1.0, np.abs(left)), axis=1)
        taken[every, best] = True
        index[:, step] = best
        along = inner[every, :step, best]
        square = 1.0 - np.square(along).sum(axis=1)
        # An atom in the span of the chosen ones adds nothing.
        fresh = square > 64 * np.finfo(left.dtype).eps
        inverse = np.where(fresh, 1.0 / np.sqrt(np.where(fresh, square, 1.0)), 0.0)
        inverse = inverse.astype(left.dtype)
        vector = gram[best] - (along[:, None, :] @ inner[:, :step])[:, 0]
        inner[:, step] = vector * inverse[:, None]
        weight[:, step] = left[every, best] * inverse
        left -= weight[:, step, None] * inner[:, step]
        triangle[:, :step, step] = along
        triangle[:, step, step] = np.where(fresh, np.sqrt(np.maximum(square, 0.0)), 1.0)
    return Codes(index, np.linalg.solve(triangle, weight[:, :, None])[:, :, 0])


def best_dictionary(codes: Array, signals: Array) -> Array:
    """The least-squares dictionary (atoms, n) for codes (count, atoms); unused atoms are zero."""
    used = np.flatnonzero(np.abs(codes).sum(axis=0))
    dictionary = np.zeros((codes.shape[1], signals.shape[1]), signals.dtype)
    chosen = codes[:, used].astype(np.float64)
    normal = chosen.T @ chosen
    normal[np.diag_indices_from(normal)] *= 1.0 + 1e-12
    dictionary[used] = np.linalg.solve(normal, chosen.T).astype(signals.dtype) @ signals
    return dictionary


def rotated(signals: Array) -> Array:
    """Signals (count, at most count) with the inner products of `signals` (count, n)."""
    if signals.shape[1] <= len(signals):
        return signals
    wide = signals.astype(np.float64)
    gram = wide @ wide.T
    # Signals may be linearly dependent: rounding would make the matrix indefinite.
    gram[np.diag_indices_from(gram)] += 1e-12 * np.trace(gram)
    return np.linalg.cholesky(gram).astype(signals.dtype)


def _unit(rows: Array) -> Array:
    length = np.linalg.norm(rows, axis=-1, keepdims=True)
    return rows / np.maximum(length, np.finfo(rows.dtype).tiny)
