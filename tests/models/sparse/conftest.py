"""A dataset, an ensemble trained on it, and its codes in that."""

import pytest
from small_btf import write_dataset
from trained import FEW, SHAPE, train

from addon.models.sparse.coding import code


@pytest.fixture(scope="package")
def dataset(tmp_path_factory):
    return write_dataset(tmp_path_factory.mktemp("sparse") / "a.nacre", SHAPE)


@pytest.fixture(scope="package")
def ensemble(dataset):
    return train([dataset])


@pytest.fixture(scope="package")
def model(dataset, ensemble):
    return code(dataset, ensemble, FEW)
