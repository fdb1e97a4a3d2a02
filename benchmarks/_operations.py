"""What a fit has to do at least: single-precision operations, and bytes to and from memory.

Every count is of the algorithm as the papers state it, in the reduced space and in the cheapest
order of mode products known to us, whatever the compiled fit really does: work that it does twice
counts once. A multiplication and an addition are two operations. Gram matrices are symmetric, so
n x n of them over k columns take n (n + 1) k. Samples are half floats (2 bytes), everything else 4.
A tensor that one part of a stage makes and the next reads counts once written and once read;
bases, cores and Gram matrices are small and count nothing, nor do eigenvalues (n^3 for n <= 500)
and the search, whose equations are K R unknowns a row. Modes are L (light rows: channels * light),
V, Y, X; N = L V Y X; R_n, C_n, K_n as in the papers; m_n = K_n I_n memberships where n is
clustered, else m_n = I_n; B = C_1 C_2 clusters.

N-SVD (De Lathauwer et al. 2000); n1 is the first mode with a rank, S = N R_n1 / I_n1 the size of
the samples projected on its basis
    covariance      N (I_n1 + 1)                          reads 2 N
    projection      the sequentially truncated HOSVD: 2 N R_n1, then for every further mode with a
                    rank, of what is left, M values: its Gram M (I_n + 1) and its product 2 M R_n.
                    Reads 2 N, writes and reads 4 S
    iteration       alternating least squares. From the second on, the projection again: 2 N R_n1,
                    reads 2 N, writes 4 S. For every other mode n: the projected tensor times the
                    bases of all modes but n and n1, and the Gram of n; reads 4 S. Ends here if the
                    error falls no more
    completing      the samples times all bases but that of n1, the Gram of n1 and the core; reads
                    2 N
    Products with several bases go by falling 1/R_n - 1/I_n, which takes the fewest operations
N-SVD of two modes a and b, the others left in full: nothing but Grams, so nothing is written
    covariance      N (I_a + 1)                           reads 2 N
    projection      2 N R_a + (N R_a / I_a) (I_b + 1)     reads 2 N
    iteration       from the second on, that projection again; reads 2 N
    completing      the same with a and b exchanged; reads 2 N
    core            as the projection on global bases, with which it counts once
Global bases of one mode n (Section 5.2)
    covariance      N (I_n + 1)                           reads 2 N
    projection      2 N R_n                               reads 2 N, writes 4 N R_n / I_n
Global bases of y and x
    N-SVD of two modes; then the projection 2 N R_y + 2 (N R_y / Y) R_x, reads 2 N,
    writes 4 N R_y R_x / (Y X)
K-CTA, view clustered, light global; P = R_L Y X values a view, M = m_V
    iteration, clustering (Eqs. 9 to 19)
        expanded cores       B 2 R_V R_L (R_y R_x X + R_y Y X)
        projections          2 V B R_V P
        Gram                 B R_V (B R_V + 1) P
        reads 4 V P, writes and reads the expanded cores, 8 B R_V P
    iteration, decomposition (Eqs. 20 to 22), one sweep, for every cluster of n members
        what others leave    2 n min(K - 1, 3) R_V P: either each member's other clusters are
                             subtracted, or one residual is kept, to which a cluster's own part is
                             added before and from which it is subtracted after its update
        view                 2 n R_L (Y X R_x + Y R_y R_x) + n (n + 1) R_L R_y R_x
        y, x and core        2 R_V n P + 2 R_V R_L (Y X R_x + Y X R_y + R_y X R_x)
                             + Y (Y + 1) R_V R_L R_x + X (X + 1) R_V R_L R_y
        reads 4 n P of the samples, writes the residual and reads it twice, 12 n P
    first clusters: that decomposition with K = 1, three sweeps, and the start of each: one more
        pass over the members (2 R_V n P + n (n + 1) P)
MK-CTA, light and view clustered, y and x global; Q = R_y R_x
    iteration, clustering (Eqs. 4 to 17), for light and the same with light and view exchanged
        expanded cores       2 m_V C_L R_L R_V Q
        projections          2 L m_V C_L R_L Q            reads 4 L V Q
        Gram, for both       w (w + 1) Q, w = B R_L R_V
    iteration, decomposition (Eqs. 12 to 14), one sweep, sums over clusters of n_L x n_V members
        what others leave    2 n_L n_V min(K_L K_V - 1, 3) R_L Q
        light                2 n_L n_V R_V Q + n_L (n_L + 1) R_V Q
        view and core        2 n_L n_V R_L Q + n_V (n_V + 1) R_L Q + 2 n_V R_V R_L Q
        reads 4 n_L n_V Q, writes the residual and reads it twice, 12 n_L n_V Q
    first clusters: that decomposition with K = 1, three sweeps
Members are spread evenly over clusters: n = M / C.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import prod

from ._fits import Settings


@dataclass(frozen=True)
class Work:
    """Operations and bytes of one part of a stage."""

    operations: float
    bytes: float

    def seconds(self, products: float, moved: float) -> float:
        """The least time at these rates: whichever of both takes longer."""
        return max(self.operations / products, self.bytes / moved)


@dataclass(frozen=True)
class Counts:
    """The work of each stage of a fit of a tensor of this shape (L, V, Y, X)."""

    shape: tuple[int, ...]
    settings: Settings

    def stage(self, message: str, mixtures: bool) -> list[Work]:
        """The parts of the stage that a fit reports with this message.

        `mixtures` says whether an iteration has all mixture clusters or, in MK-CTA's first
        iterations, one.
        """
        if message.startswith("N-SVD: "):
            name, *number = message.removeprefix("N-SVD: ").split()
            return self._nsvd(name, again=number != ["1"])
        if message == "Global basis: covariance":
            (mode,) = self.settings.global_modes
            size = prod(self.shape)
            return [Work(size * (self.shape[mode] + 1), 2 * size)]
        if message == "Projection on the global bases":
            return self._projection()
        if message == "First clusters":
            return self._decomposition(False, sweeps=3)
        if message.endswith(": clustering"):
            return self._clustering(mixtures)
        if message.endswith(": decomposition"):
            return self._decomposition(mixtures, sweeps=1)
        if message in ("Done", "N-SVD: done"):
            return []
        raise ValueError(f"a stage without a formula: {message}")

    def _nsvd(self, stage: str, again: bool) -> list[Work]:
        """A stage of an N-SVD; `again` for iterations after the first."""
        shape, size = self.shape, prod(self.shape)
        ranks = [
            rank if not self.settings.clusters or n in self.settings.global_modes else 0
            for n, rank in enumerate(self.settings.ranks)
        ]
        first, *rest = (n for n in range(4) if ranks[n])
        if stage == "covariance":
            return [Work(size * (shape[first] + 1), 2 * size)]
        if stage == "core" or stage == "done":
            return []
        if len(rest) == 1:
            a, b = (rest[0], first) if stage == "completing" else (first, rest[0])
            left = size * ranks[a] / shape[a]
            return [Work(2 * size * ranks[a] + left * (shape[b] + 1), 2 * size)]
        small = size * ranks[first] / shape[first]
        project = Work(2 * size * ranks[first], 2 * size + 4 * small)
        if stage == "projection":
            left, operations = small, 0.0
            for n in rest:
                operations += left * (shape[n] + 1) + 2 * left * ranks[n]
                left *= ranks[n] / shape[n]
            return [project, Work(operations, 4 * small)]
        rest.sort(key=lambda n: 1 / shape[n] - 1 / ranks[n])
        if stage == "completing":
            left, operations = float(size), 0.0
            for n in rest:
                operations += 2 * left * ranks[n]
                left *= ranks[n] / shape[n]
            operations += left * (shape[first] + 1) + 2 * left * ranks[first]
            return [Work(operations, 2 * size)]
        operations = 0.0
        for n in rest:
            left = small
            for other in rest:
                if other != n:
                    operations += 2 * left * ranks[other]
                    left *= ranks[other] / shape[other]
            operations += left * (shape[n] + 1)
        others = Work(operations, 4 * small * len(rest))
        return [project, others] if again else [others]

    def _projection(self) -> list[Work]:
        left = size = float(prod(self.shape))
        operations = 0.0
        for n in self.settings.global_modes:
            operations += 2 * left * self.settings.ranks[n]
            left *= self.settings.ranks[n] / self.shape[n]
        return [Work(operations, 2 * size + 4 * left)]

    def _clustering(self, mixtures: bool) -> list[Work]:
        (light, view, y, x), (rl, rv, ry, rx) = self.shape, self.settings.ranks
        settings = self.settings
        if 0 not in settings.clusters:
            count, values = settings.clusters[1], rl * y * x
            width = count * rv
            operations = (
                2 * width * rl * (ry * rx * x + ry * y * x)
                + 2 * view * width * values
                + width * (width + 1) * values
            )
            return [Work(operations, 4 * view * values + 8 * width * values)]
        cl, cv = settings.clusters[0], settings.clusters[1]
        kl, kv = (settings.mixtures[0], settings.mixtures[1]) if mixtures else (1, 1)
        columns = ry * rx
        width = cl * cv * rl * rv
        moved = 4 * light * view * columns
        return [
            Work(2 * kv * view * cl * rl * columns * (light + rv), moved),
            Work(2 * kl * light * cv * rv * columns * (view + rl), moved),
            Work(width * (width + 1) * columns, 4 * width * columns),
        ]

    def _decomposition(self, mixtures: bool, sweeps: int) -> list[Work]:
        (light, view, y, x), (rl, rv, ry, rx) = self.shape, self.settings.ranks
        settings = self.settings
        if 0 not in settings.clusters:
            k, count = settings.mixtures[1] if mixtures else 1, settings.clusters[1]
            n, values = k * view / count, rl * y * x
            sweep = (
                2 * n * rl * (y * x * rx + y * ry * rx)
                + n * (n + 1) * rl * ry * rx
                + 2 * rv * n * values
                + 2 * rv * rl * (y * x * rx + y * x * ry + ry * x * rx)
                + y * (y + 1) * rv * rl * rx
                + x * (x + 1) * rv * rl * ry
            )
            start = 2 * rv * n * values + n * (n + 1) * values if sweeps > 1 else 0
            others = 2 * n * min(k - 1, 3) * rv * values
            passes = 2 + 2 * sweeps
            return [
                Work(count * (others + start + sweeps * sweep), count * passes * 4 * n * values)
            ]
        cl, cv = settings.clusters[0], settings.clusters[1]
        kl, kv = (settings.mixtures[0], settings.mixtures[1]) if mixtures else (1, 1)
        nl, nv, columns = kl * light / cl, kv * view / cv, ry * rx
        others = 2 * nl * nv * min(kl * kv - 1, 3) * rl * columns
        sweep = columns * (
            2 * nl * nv * rv
            + nl * (nl + 1) * rv
            + 2 * nl * nv * rl
            + nv * (nv + 1) * rl
            + 2 * nv * rv * rl
        )
        moved = (2 + 2 * sweeps) * 4 * nl * nv * columns
        return [Work(cl * cv * (others + sweeps * sweep), cl * cv * moved)]
