"""A small dataset for sparse codes, and how an ensemble is trained on it."""

from addon.models.sparse import training

SHAPE = (6, 7, 8, 10, 3)  # patches of 4 x 4 reach over the edge along x
PATCH = (4, 4)
EVERY = {key: 16 * 42 for key in "YUV"}
FEW = {"Y": 60, "U": 12, "V": 12}


def train(datasets, **changes):
    settings = {"patch": PATCH, "dictionaries": 2, "sweeps": 4, "sparsity": FEW}
    return training.train(datasets, **(settings | changes))


def one_line(error, *words):
    text = str(error.value)
    assert "\n" not in text
    for word in words:
        assert word in text
