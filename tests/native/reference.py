"""K-CTA and N-SVD written out in double precision in the original tensor space: slow and obvious.

Tensors have the modes (light rows, view, y, x); `kcta` clusters the view. Equation numbers are
those of Tsai and Shih 2012.
"""

from math import prod

import numpy as np

VIEW = 1


def tensor_of(samples):
    """(light, view, y, x, channel) -> (channels * light + channel, view, y, x), float64."""
    light, view, y, x, channel = samples.shape
    moved = samples.astype(np.float64).transpose(0, 4, 1, 2, 3)
    return np.ascontiguousarray(moved).reshape(light * channel, view, y, x)


def unfold(a, mode):
    return np.moveaxis(a, mode, 0).reshape(a.shape[mode], -1)


def mode_product(a, u, mode):
    """A x_mode U (Eq. 2)."""
    return np.moveaxis(np.tensordot(u, a, (1, mode)), 0, mode)


def expand(core, bases):
    for mode, u in enumerate(bases):
        if u is not None:
            core = mode_product(core, u, mode)
    return core


def project(a, bases, skip=None):
    for mode, u in enumerate(bases):
        if u is not None and mode != skip:
            a = mode_product(a, u.T, mode)
    return a


def leading(a, mode, rank):
    """The leading left singular vectors of the mode's unfolding; zero columns past its rows."""
    u = np.linalg.svd(unfold(a, mode), full_matrices=False)[0][:, :rank]
    return np.pad(u, ((0, 0), (0, rank - u.shape[1])))


def cluster_bases(model, clusters):
    """U_n,c of every cluster in order, each a list of (I, R) with zero rows where i is no member.

    model: as `nacre_native` returns it. clusters: {mode: C} of the clustered modes.
    """
    basis = [b.astype(np.float64) for b in model["basis"]]
    for vector in np.ndindex(*(clusters[mode] for mode in sorted(clusters))):
        at = dict(zip(sorted(clusters), vector, strict=True))
        whole = int(np.ravel_multi_index(vector, [clusters[m] for m in sorted(clusters)]))
        bases = []
        for mode, b in enumerate(basis):
            if mode not in clusters:
                bases.append(b[whole if len(b) > 1 else 0, :, 0])
                continue
            others = [m for m in sorted(clusters) if m != mode]
            owner = 0
            for m in others:
                owner = owner * clusters[m] + at[m]
            assert len(b) == prod(clusters[m] for m in others)
            members = model["members"][mode]
            rows = np.repeat(members, b.shape[1] // len(members), axis=0)  # colours of a light
            bases.append(np.einsum("ik,ikr->ir", rows == at[mode], b[owner]))
        yield bases


def reconstruct(model, clusters=None):
    """The sum of Eq. 8 (MK-CTA: Eq. 3) for a model as `nacre_native` returns it, in double."""
    if clusters is None:
        clusters = {VIEW: len(model["core"])} if "members" in model else {}
    return sum(
        expand(core, bases)
        for core, bases in zip(
            model["core"].astype(np.float64), cluster_bases(model, clusters), strict=True
        )
    )


def relative_error(samples, model, clusters=None):
    a = tensor_of(samples)
    return np.sum((a - reconstruct(model, clusters)) ** 2) / np.sum(a**2)


class Cluster:
    def __init__(self, bases):
        self.bases = bases  # of the other modes; [VIEW] is None
        self.core = None
        self.mixing = None  # U_m,c with its zero rows

    def whole(self):
        """Rows span the cluster's subspace of view subtensors: ufm(Z_c x_n U_n,c)."""
        return unfold(expand(self.core, self.bases), VIEW)

    def approximation(self):
        bases = list(self.bases)
        bases[VIEW] = self.mixing
        return expand(self.core, bases)


def decompose(members, ranks, bases, sweeps):
    """N-SVD of the members by alternating least squares; light is global (its basis is None)."""
    if bases[2] is None:  # the start: sequentially truncated HOSVD, then one pass
        start = mode_product(members, leading(members, VIEW, ranks[VIEW]).T, VIEW)
        for mode in (2, 3):
            bases[mode] = leading(project(start, bases, mode), mode, ranks[mode])
    for _ in range(sweeps):
        mixing = leading(project(members, bases), VIEW, ranks[VIEW])
        start = mode_product(members, mixing.T, VIEW)
        for mode in (2, 3):
            bases[mode] = leading(project(start, bases, mode), mode, ranks[mode])
    return mixing, project(start, bases)


def batched(clusters, overlap):
    """The order in which clusters are decomposed: batches of those that share no element and may
    be decomposed at the same time, first fit (Tsai 2015, Section 3.6)."""
    batches = []
    for c in clusters:
        batch = next((b for b in batches if not any(overlap(c, d) for d in b)), None)
        if batch is None:
            batches.append([c])
        else:
            batch.append(c)
    return [c for batch in batches for c in batch]


def update(a, clusters, c, members, ranks, sweeps):
    """Eqs. 20 to 22: decompose the members of what the other clusters leave over."""
    residual = a - sum(
        (
            other.approximation()
            for j, other in enumerate(clusters)
            if j != c and other.core is not None
        ),
        np.zeros_like(a),
    )
    cluster = clusters[c]
    mixing, cluster.core = decompose(residual[:, members], ranks, cluster.bases, sweeps)
    cluster.mixing = np.zeros((a.shape[VIEW], ranks[VIEW]))
    cluster.mixing[members] = mixing


def greedy(item, clusters, mixtures):
    """Eqs. 9 to 15 for one view subtensor (a vector), all in the original space."""
    wholes = [cluster.whole() for cluster in clusters]
    chosen, coefficients, rest = [], None, item
    for _ in range(mixtures):
        # || ufm(R^(c)) V_c^T ||^2 is the energy of the projection on the cluster's subspace.
        energy = [
            -1.0 if c in chosen else np.sum((np.linalg.pinv(w.T, rcond=1e-6) @ rest @ w) ** 2)
            for c, w in enumerate(wholes)
        ]
        chosen.append(int(np.argmax(energy)))
        stacked = np.concatenate([wholes[c] for c in chosen])
        coefficients = np.linalg.pinv(stacked.T, rcond=1e-6) @ item
        rest = item - coefficients @ stacked
    return chosen, coefficients.reshape(mixtures, -1)


def kcta(samples, ranks, seeds, mixtures, iterations):
    """Errors (of the start and each iteration, until one would rise) and the last membership.

    seeds: the first cluster of each view. The light basis is global (Eq. 23).
    """
    whole = tensor_of(samples)
    energy = np.sum(whole**2)
    light = leading(whole, 0, ranks[0])
    a = mode_product(whole, light.T, 0)
    clusters = [Cluster([None] * 4) for _ in range(max(seeds) + 1)]
    for c in range(len(clusters)):
        update(a, clusters, c, np.flatnonzero(seeds == c), ranks, sweeps=3)

    errors, members, result = [], [(c,) for c in seeds], None
    while True:
        left = a - sum(cluster.approximation() for cluster in clusters)
        error = (energy - np.sum(a**2) + np.sum(left**2)) / energy
        if errors and error > errors[-1]:
            return errors, result
        errors.append(error)
        result = members
        if len(errors) > iterations:
            return errors, result
        found = [greedy(item, clusters, mixtures) for item in unfold(a, VIEW)]
        members = [tuple(sorted(chosen)) for chosen, _ in found]
        for c, cluster in enumerate(clusters):
            cluster.mixing = np.zeros((len(found), ranks[VIEW]))
            for i, (chosen, coefficients) in enumerate(found):
                if c in chosen:
                    cluster.mixing[i] = coefficients[chosen.index(c)]
        order = batched(
            range(len(clusters)), lambda c, d, members=members: any({c, d} <= {*m} for m in members)
        )
        for c in order:
            rows = np.array([i for i, chosen in enumerate(members) if c in chosen])
            update(a, clusters, c, rows, ranks, sweeps=1)
