"""A fit for a process of its own, whose memory is watched."""

import nacre_native
import numpy as np

RANKS = (12, 2, 16, 16)


def opened(path, memory, scratch):
    return np.load(path, mmap_mode="r"), memory, scratch


def fit(prepared):
    samples, memory, scratch = prepared
    views = samples.shape[1]
    model = nacre_native.fit_clustered(
        samples,
        RANKS,
        clusters={1: 2},
        mixtures={1: 2},
        global_modes=(0,),
        directions={1: np.arange(views, dtype=float)[:, None]},
        iterations=2,
        tolerance=0.0,
        memory=memory,
        scratch=scratch,
    )
    return model["errors"]
