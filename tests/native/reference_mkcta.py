"""MK-CTA written out in double precision in the original tensor space: slow and obvious.

Equation, section and algorithm numbers are those of Tsai 2015. Tensors have the modes (light rows,
view, y, x). Bases are (I, R), zero in the rows of items that are no members.
"""

from itertools import combinations, product

import numpy as np

from .reference import batched, expand, leading, mode_product, project, tensor_of, unfold

FIRST_SWEEPS = 3
WARM_UP = 4, 0.02
"""K = 1 for so many iterations, or until the error falls by less than this part (Section 4.2)."""


def pinv(rows):
    """The pseudo-inverse of the matrix with these columns; a direction counts as dependent if its
    squared sine is below 1e-6, whatever the length of the columns."""
    length = np.linalg.norm(rows, axis=1)
    scale = np.divide(1, length, out=np.zeros_like(length), where=length > 0)
    return scale[:, None] * np.linalg.pinv((scale[:, None] * rows).T, rcond=1e-3)


def orthonormal(u):
    """The post-process (Section 3.5.3): orthonormal columns with the same span, the rest zero."""
    left, s, _ = np.linalg.svd(u, full_matrices=False)
    left = np.where(s > 1e-3 * s.max(initial=0), left, 0)
    return np.pad(left, ((0, 0), (0, u.shape[1] - left.shape[1])))


class Fit:
    """The state of Algorithm 1. a: the tensor reduced by the global bases, of which `modes` leaves
    the rest, clustered ones first. members: {mode: the set of clusters of each item}."""

    def __init__(self, a, ranks, modes, members, tied, counts):
        self.a, self.ranks, self.modes, self.tied = a, ranks, modes, tied
        self.members, self.counts = dict(members), counts
        self.vectors = list(product(*(range(counts[mode]) for mode in members)))
        self.core = dict.fromkeys(self.vectors)
        self.bases = {c: [None] * 4 for c in self.vectors}
        self.decompose(FIRST_SWEEPS)

    def part(self, c, mode):
        return c[list(self.members).index(mode)]

    def rows(self, c, mode):
        """Eq. 14."""
        if mode not in self.members:
            return np.arange(self.a.shape[mode])
        own = [self.part(c, mode) in found for found in self.members[mode]]
        return np.flatnonzero(np.repeat(own, self.tied[mode]))

    def approximation(self, c):
        return 0 if self.core[c] is None else expand(self.core[c], self.bases[c])

    def left_over(self, but=None):
        return self.a - sum(self.approximation(c) for c in self.vectors if c != but)

    def overlap(self, c, d):
        return all(set(self.rows(c, m)) & set(self.rows(d, m)) for m in self.members)

    def decompose(self, sweeps):
        """Section 3.6."""
        for c in batched(self.vectors, self.overlap):
            where = np.ix_(*(self.rows(c, mode) for mode in range(4)))
            block = self.left_over(but=c)[where]  # Eq. 12
            first = self.core[c] is None
            bases = [None] * 4
            for mode in self.modes:
                if not first:
                    own = self.bases[c][mode][where[mode].ravel()]
                    bases[mode] = orthonormal(own) if mode in self.members else own
            for _sweep in range(sweeps + first):  # the first one is the truncated HOSVD
                for mode in self.modes:
                    bases[mode] = leading(project(block, bases, mode), mode, self.ranks[mode])
            self.core[c] = project(block, bases)
            for mode in self.modes:
                whole = np.zeros((self.a.shape[mode], self.ranks[mode]))
                whole[where[mode].ravel()] = bases[mode]
                self.bases[c][mode] = whole

    def cluster(self, mode, mixtures, search):
        """Section 3.5 for one mode."""
        tied, count = self.tied[mode], self.counts[mode]
        subsets = [[c for c in self.vectors if self.part(c, mode) == j] for j in range(count)]
        spans = []  # Eqs. 6 and 7
        for subset in subsets:
            whole = []
            for c in subset:
                bases = list(self.bases[c])
                bases[mode] = None
                whole.append(unfold(expand(self.core[c], bases), mode))
            spans.append(np.concatenate(whole))
        items = unfold(self.a, mode).reshape(len(self.members[mode]), tied, -1)
        inverses = {}

        def solve(chosen, item):
            """Eq. 8: coefficients of each row, and the energy they explain (Eq. 4)."""
            stacked = np.concatenate([spans[j] for j in chosen])
            if chosen not in inverses:
                inverses[chosen] = pinv(stacked)
            coefficients = item @ inverses[chosen].T
            return coefficients, np.sum((coefficients @ stacked) ** 2)

        def best(sets, item):
            return sets[int(np.argmax([solve(chosen, item)[1] for chosen in sets]))]

        found = []
        for item, present in zip(items, self.members[mode], strict=True):
            if search == "optimal":  # Algorithm 2
                chosen = best(list(combinations(range(count), mixtures)), item)
            else:  # Algorithm 3; clusters that the item has stay where they explain more
                chosen = ()
                for _ in range(mixtures):
                    more = [j for j in range(count) if j not in chosen]
                    chosen = best([tuple(sorted((*chosen, j))) for j in more], item)
                if len(present) == mixtures:
                    chosen = best([chosen, present], item)
            found.append(chosen)
        coefficients = [
            dict(zip(chosen, np.split(solve(chosen, item)[0], mixtures, axis=1), strict=True))
            for chosen, item in zip(found, items, strict=True)
        ]
        self.split_empty(mode, subsets, spans, items, coefficients)
        self.members[mode] = [tuple(sorted(own)) for own in coefficients]
        for j, subset in enumerate(subsets):
            for owner, c in enumerate(subset):
                basis = np.zeros((self.a.shape[mode], self.ranks[mode]))
                columns = slice(owner * self.ranks[mode], (owner + 1) * self.ranks[mode])
                for i, own in enumerate(coefficients):
                    if j in own:
                        basis[i * tied : (i + 1) * tied] = own[j][:, columns]
                self.bases[c][mode] = basis

    def split_empty(self, mode, subsets, spans, items, coefficients):
        """Section 5.3 of the K-CTA paper: an empty cluster takes the worse half of the worst one's
        members, and begins as its copy."""
        for empty in range(self.counts[mode]):
            if any(empty in own for own in coefficients):
                continue
            errors = [
                np.sum((item - sum(u @ spans[j] for j, u in own.items())) ** 2)
                for item, own in zip(items, coefficients, strict=True)
            ]
            lists = [
                [i for i, own in enumerate(coefficients) if j in own]
                for j in range(self.counts[mode])
            ]
            sums = [sum(errors[i] for i in own) if len(own) > 1 else -1 for own in lists]
            worst = int(np.argmax(sums))
            order = sorted(lists[worst], key=errors.__getitem__)
            for i in order[(len(order) + 1) // 2 :]:
                coefficients[i][empty] = coefficients[i].pop(worst)
            spans[empty] = spans[worst]
            for to, source in zip(subsets[empty], subsets[worst], strict=True):
                self.core[to] = self.core[source]
                self.bases[to] = list(self.bases[source])


def mkcta(samples, ranks, seeds, mixtures, iterations, search="auto", global_mode=None):
    """Errors of the start and each iteration, until one would rise, and the memberships after each.

    seeds: {mode: the first cluster of each item}; mixtures: {mode: K}.
    """
    whole = tensor_of(samples)
    energy = np.sum(whole**2)
    a = whole
    if global_mode is not None:  # Eq. 23 of the K-CTA paper
        basis = leading(whole, global_mode, ranks[global_mode])
        a = mode_product(whole, basis.T, global_mode)
    rest = [mode for mode in range(4) if mode not in seeds and mode != global_mode]
    members = {mode: [(int(c),) for c in seeds[mode]] for mode in seeds}
    tied = {mode: a.shape[mode] // len(seeds[mode]) for mode in seeds}
    counts = {mode: int(max(seeds[mode])) + 1 for mode in seeds}
    fit = Fit(a, ranks, [*seeds, *rest], members, tied, counts)

    def error():
        return (energy - np.sum(a**2) + np.sum(fit.left_over() ** 2)) / energy

    def grown():
        return all(len(fit.members[mode][0]) == mixtures[mode] for mode in seeds)

    errors, history, warm = [error()], [dict(fit.members)], False
    while len(errors) <= iterations:
        warm = warm or grown() or len(errors) > WARM_UP[0]
        warm = warm or (len(errors) > 1 and errors[-2] - errors[-1] <= WARM_UP[1] * errors[-1])
        before = dict(fit.members), dict(fit.core), {c: list(u) for c, u in fit.bases.items()}
        for mode in seeds:
            k = mixtures[mode] if warm else 1
            fit.cluster(mode, k, ("optimal" if k < 3 else "greedy") if search == "auto" else search)
        fit.decompose(1)
        now = error()
        if now > errors[-1]:  # Section 5.4
            fit.members, fit.core, fit.bases = before
            if warm:
                break
            warm = True
            continue
        errors.append(now)
        history.append(dict(fit.members))
    return errors, history
