"""A model written out with dense, mostly zero bases: slow and obvious."""

import numpy as np

from addon.models.clustered_tucker import MODES


def dense_basis(model, mode, vector):
    """U of one mode in the cluster vector {mode: cluster}, (rows, R): zero where not a member."""
    basis = model.bases[mode]
    owner = 0
    if len(basis) > 1:
        for name, count in model.clusters.items():
            if name != mode:
                owner = owner * count + vector[name]
    if mode not in model.clusters:
        return basis[owner, :, 0]
    rows = np.zeros((basis.shape[1], basis.shape[3]))
    for row in range(len(rows)):
        item = row // model.channels if mode == "light" else row
        for slot, cluster in enumerate(model.members[mode][item]):
            if cluster == vector[mode]:
                rows[row] = basis[owner, row, slot]
    return rows


def dense(model):
    """Samples (light, view, y, x, channel), K-CTA's Eq. 8 term by term."""
    total = 0.0
    for number, indices in enumerate(np.ndindex(*model.clusters.values())):
        vector = dict(zip(model.clusters, indices, strict=True))
        light, view, y, x = (dense_basis(model, mode, vector) for mode in MODES)
        light = light.reshape(-1, model.channels, light.shape[1])
        core = model.core[number].astype(float)
        total = total + np.einsum("abcd,lna,vb,yc,xd->lvyxn", core, light, view, y, x)
    return total
