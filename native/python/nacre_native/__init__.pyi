"""Compression of measured appearance: N-SVD, CTA, K-CTA, MK-CTA and sparse dictionaries.

`samples` are float16 or float32, C-contiguous, axes (light, view, y, x, channel); they are read
where they lie (a read-only memory map will do) and not copied. The tensor that is decomposed has
the modes 0 to 3: light rows, view, y, x, where light row `channels * light + channel` is one colour
of one light. Ranks, bases and core axes follow this order.

Wrong arguments raise ValueError with one line that names the argument and what was expected; NaN
and infinities are named by their index. `progress(fraction, message)` is called from the calling
thread, about twenty times a second; returning False raises Cancelled, and what it raises comes out.
The same arguments give the same bits for any number of threads (0: all).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

__version__: str

class Cancelled(Exception):
    """The progress callback asked for a stop."""

class NsvdModel(TypedDict):
    core: NDArray[np.float32]  # (1, RL, RV, RY, RX)
    basis: list[NDArray[np.float32]]  # (1, I, 1, R) of each mode, orthonormal columns
    # ||A - approximation||^2 / ||A||^2 after each iteration, or of the HOSVD if there is none
    errors: list[float]
    squared_norm: float  # ||A||^2
    iterations: int
    passes: float  # how often the samples were read: values read over values there are

class ClusteredModel(TypedDict):
    core: NDArray[
        np.float32
    ]  # (product of C, RL, RV, RY, RX), clusters in mode order, last fastest
    # (owners, I, K, R) of each mode: owners are the combinations of the other clustered modes'
    # clusters, 1 for a global basis; K is 1 unless the mode is clustered
    basis: list[NDArray[np.float32]]
    members: dict[int, NDArray[np.uint32]]  # (items, K) of each clustered mode, ascending
    errors: list[float]  # of the first guess and after each iteration; never rising
    squared_norm: float  # ||A||^2
    iterations: int
    passes: float  # how often the samples were read

def fit_nsvd(
    samples: NDArray[Any],
    ranks: Sequence[int],
    *,
    iterations: int = 20,
    tolerance: float = 1e-4,
    threads: int = 0,
    memory: int = 0,
    scratch: str = "",
    domain: str = "linear",
    start: NsvdModel | None = None,
    checkpoint: Callable[[NsvdModel], object] | None = None,
    progress: Callable[[float, str], bool] | None = None,
) -> NsvdModel:
    """N-SVD: truncated HOSVD, then alternating least squares until the error falls by less than
    `tolerance` of itself (De Lathauwer et al. 2000). No iterations: the truncated HOSVD alone, each
    mode after the one before.

    `memory` bounds the anonymous memory of the process in bytes, what it has in use already
    included; 0 is no bound. What exceeds it lies in files in the folder `scratch` ("": the
    system's) that nobody sees and that go with the process, however it ends; RuntimeError if there
    is no room for them. Pages of samples that are a read-only numpy.memmap, or a view of one, are
    dropped behind the reader.

    `domain` "log" fits log(Y + 0.01), U / (Y + 0.01) and V / (Y + 0.01) of samples in red, green
    and blue, which are converted as they are read.

    `checkpoint` is called with the model after each iteration; given as `start`, the fit goes on
    from there, and the result has the same bits as without the break."""

def fit_clustered(
    samples: NDArray[Any],
    ranks: Sequence[int],
    *,
    clusters: Mapping[int, int],
    mixtures: Mapping[int, int] = ...,
    global_modes: Sequence[int] = (),
    directions: Mapping[int, ArrayLike],
    search: str = "auto",
    iterations: int = 50,
    tolerance: float = 5e-4,
    seed: int = 0,
    threads: int = 0,
    memory: int = 0,
    scratch: str = "",
    domain: str = "linear",
    start: Mapping[str, Any] | None = None,
    checkpoint: Callable[[dict[str, Any]], object] | None = None,
    progress: Callable[[float, str], bool] | None = None,
) -> ClusteredModel:
    """CTA and K-CTA (Tsai and Shih 2012, Algorithm 1) for one clustered mode, MK-CTA (Tsai 2015,
    Algorithm 1) for several: `clusters` and `mixtures` are {mode: C} and {mode: K}.

    `directions` {mode: (items, any)}: where the items of each clustered mode lie, in which the
    first clusters are found; the colours of a light are one item. `search`: "kcta", "greedy" (OLS),
    "optimal" or "auto". Stops when neither the sum of core norms nor the error changes by more than
    `tolerance` of itself, or when the error would rise (the last result is then restored).
    `memory`: bytes of anonymous memory, beyond which large tensors are in files in `scratch`.
    `checkpoint(state)` is called after each iteration that another follows; `start` is such a state
    or any model of these shapes (with no errors: they are computed)."""

def core_gram(
    core: ArrayLike, basis: Sequence[ArrayLike], *, clustered: int = 1, threads: int = 0
) -> NDArray[np.float64]:
    """gram[j, c] = ufm(Z_j^(c)) ufm(Z_c)^T of a K-CTA model, (C, C, R, R): Eqs. 14 and 17. The
    clustered mode's own basis is not looked at."""

def search_clusters(
    projections: ArrayLike,
    gram: ArrayLike,
    mixtures: int,
    *,
    candidates: ArrayLike | None = None,
    search: str = "kcta",
    tied: int = 1,
    threads: int = 0,
) -> tuple[NDArray[np.uint32], NDArray[np.float64]]:
    """Mixture clusters and mixing coefficients in the reduced space (Tsai and Shih 2012, Eqs. 9 to
    15; Tsai 2015, Eqs. 4, 8 and 11).

    projections (n, C, R): ufm(A<i>^(c)) ufm(Z_c)^T; gram as from core_gram; candidates
    (items, q, K): further sets for each item, of which the one that explains most energy wins, the
    search's own in doubt. `search` as in fit_clustered, but not "auto". `tied` rows that follow
    each other share their clusters: items are n / tied. Returns members (items, K), ascending in a
    row, and coefficients (n, K, R)."""

class Evaluator:
    """Random access to a clustered Tucker model of a BTF: y and x expanded for every texel, from
    which a texel's values take only the blocks of its light's and its view's clusters."""

    shape: tuple[int, int, int, int, int]  # (light, view, y, x, channel)
    reads: int  # core values that go into a texel for one light and view
    nbytes: int  # of the expanded core

    def __init__(
        self,
        core: ArrayLike,
        basis: Sequence[ArrayLike],
        members: Mapping[int, ArrayLike] = ...,
        clusters: Mapping[int, int] = ...,
        *,
        channels: int = 3,
        threads: int = 0,
    ) -> None:
        """`core` and `basis` as the fits return them; `members` (items, K) and `clusters` C of each
        clustered mode, by its number."""

    def decode_texels(
        self, light: ArrayLike, view: ArrayLike, texels: ArrayLike, *, threads: int = 0
    ) -> NDArray[np.float32]:
        """Unclamped values (n, channels), in the domain that was fitted, at texels y * width + x
        (n,) for one light and one view; (pairs, n, channels) for as many lights and views, with
        texels (n,) or (pairs, n)."""

class TableEvaluator:
    """Tables of a clustered Tucker model (addon/tables/tables.py) evaluated for any light and view,
    reading only the rows and clusters of the texels of the parabolic maps that are nearest to them.
    K-CTA, Section 6.3.3; MK-CTA, Section 5.1."""

    def __init__(
        self,
        core: ArrayLike,
        light: ArrayLike | None,
        view: ArrayLike,
        light_index: ArrayLike,
        view_index: ArrayLike,
    ) -> None:
        """core (C_light, C_view, R_light, view quads, Y, X, 4), light (owners, channels, K_light,
        light quads, N, N, 4) or None for occlusion, view (owners, K_view, view quads, N, N, 4), and
        the indices (K, N, N). Float32 and uint32 in C order are not copied, and are to stay as they
        are."""

    def patch(
        self, light: ArrayLike | None, view: ArrayLike, *, threads: int = 0
    ) -> NDArray[np.float32]:
        """Values (light, view, Y, X, channel) at texel centres for unit directions (n, 3) in the
        tangent frame, clamped at 0, and 0 for lights below the horizon; of occlusion, for light
        None, (view, Y, X) as they are."""

    def points(
        self, light: ArrayLike, view: ArrayLike, uv: ArrayLike, *, threads: int = 0
    ) -> NDArray[np.float32]:
        """Values (n, channel) at n points: directions (n, 3) as above, and texture coordinates
        (n, 2) that repeat with the patch; bilinear between texels."""

class Training(TypedDict):
    dictionaries: list[NDArray[np.float32]]  # (K, I, I) of each mode, atoms are columns
    members: NDArray[np.uint32]  # (n,): the dictionary of each patch
    # the objective over the squared norm, at the begin of each sweep and at the end; never rising
    # but for the rounding of single precision products
    errors: list[float]
    orthonormality: list[float]  # largest entry of |U^T U - I| after each sweep
    reseeded: list[int]  # dictionaries without patches, in each sweep
    squared_norm: float
    sweeps: int

class SparseCode(TypedDict):
    positions: NDArray[np.uint32]  # (n, sparsity), in C order of a patch's coefficients
    values: NDArray[np.float32]  # (n, sparsity), larger magnitude first, then zeros
    counts: NDArray[np.uint32]  # (n,): coefficients that are not zero
    members: NDArray[np.uint32]  # (n,)
    errors: NDArray[np.float64]  # (n,): squared error

def fit_ensemble(
    patches: NDArray[Any],
    *,
    dictionaries: int,
    sparsity: int,
    sweeps: int = 30,
    tolerance: float = 1e-3,
    reassign: int = 1,
    seed: int = 0,
    threads: int = 0,
    start: Mapping[str, Any] | None = None,
    checkpoint: Callable[[Training], object] | None = None,
    progress: Callable[[float, str], bool] | None = None,
) -> Training:
    """An ensemble of K orthonormal dictionaries for patches (n, I1, ..., IN), float16 or float32 (a
    read-only numpy.memmap will do: they are read anew in every pass, and its pages dropped).
    SparseBTF (Kavoosighafi et al. 2023), Eqs. 2a to 2d; each patch has `sparsity` coefficients.

    `reassign`: the dictionary of each patch is chosen anew in every so many sweeps. `checkpoint` is
    called with the state after each sweep; given as `start`, the training goes on from there, and
    the result has the same bits as without the break."""

def code_patches(
    patches: NDArray[Any],
    dictionaries: Sequence[ArrayLike],
    sparsity: int,
    *,
    error: float = 0.0,
    threads: int = 0,
    progress: Callable[[float, str], bool] | None = None,
) -> SparseCode:
    """Sparse codes of patches (n, I1, ..., IN): projected on every dictionary (Eq. 3), the largest
    coefficients kept until there are `sparsity` or the mean squared error is `error`; the sparsest
    dictionary wins, among equals the one of least error (Section 3.3)."""
