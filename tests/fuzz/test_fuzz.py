"""The readers on damaged files; `python -m tests.fuzz NAME` does the same, guided by coverage."""

import pytest

from tests.fuzz.harness import TARGETS, inputs, read, target, time_limit
from tests.fuzz.mutations import damaged

COUNT = 1000


@pytest.mark.parametrize("name", TARGETS)
def test_seeds_are_read(name):
    module = target(name)
    seeds = module.seeds()
    assert len(seeds) > 1
    for label, data in seeds.items():
        with time_limit():
            assert read(module, data) is None, label


@pytest.mark.parametrize("name", TARGETS)
def test_what_was_found_before(name):
    module = target(name)
    for label, data in inputs(name).items():
        try:
            with time_limit():
                read(module, data)
        except BaseException as error:
            raise AssertionError(f"{name}: {label}") from error


@pytest.mark.parametrize("name", TARGETS)
def test_damaged_files(name):
    module = target(name)
    files = list(inputs(name).values())
    refused = 0
    for number, data in enumerate(damaged(files, COUNT, seed=1)):
        try:
            with time_limit():
                refused += read(module, data) is not None
        except BaseException as error:
            raise AssertionError(f"{name}: damaged file {number}: {data!r}") from error
    # Neither all the same: the changes reach what is behind the checks, and the checks.
    assert 0.05 * COUNT < refused < COUNT
