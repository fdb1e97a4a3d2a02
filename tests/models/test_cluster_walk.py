"""The walk over numbers of clusters."""

from math import log

import pytest

from addon.models.cluster_walk import walk


def merit_about(best, asked):
    """A valley with its bottom at `best`, which notes what it is asked."""

    def merit(clusters):
        asked.append(dict(clusters))
        return sum(log(clusters[mode] / count) ** 2 for mode, count in best.items())

    return merit


@pytest.mark.parametrize("start", [1, 3, 9, 20, 60])
@pytest.mark.parametrize("best", [1, 5, 9, 14, 60])
def test_it_comes_near_to_the_best(start, best):
    asked = []
    found = walk(merit_about({"view": best}, asked), {"view": start}, {"view": 1}, {"view": 60}, 30)
    assert abs(log(found["view"] / best)) <= log(1.2)
    assert len(asked) == len({clusters["view"] for clusters in asked}) <= 16


def test_several_modes_are_walked_in_turn():
    asked = []
    limits = {"light": 1, "view": 1}, {"light": 40, "view": 40}
    best = {"light": 6, "view": 16}
    found = walk(merit_about(best, asked), {"light": 10, "view": 9}, *limits, 30)
    assert all(abs(log(found[mode] / best[mode])) <= log(1.2) for mode in best)
    assert list(found) == ["light", "view"]


def test_it_stays_within_the_limits():
    asked = []
    merit = merit_about({"view": 100}, asked)
    assert walk(merit, {"view": 7}, {"view": 5}, {"view": 12}, 30) == {"view": 12}
    assert all(5 <= clusters["view"] <= 12 for clusters in asked)
    assert walk(merit_about({"view": 1}, asked), {"view": 7}, {"view": 5}, {"view": 12}, 30) == {
        "view": 5
    }


def test_trials_are_counted():
    asked = []
    found = walk(merit_about({"view": 500}, asked), {"view": 2}, {"view": 1}, {"view": 900}, 4)
    assert len(asked) == 4
    assert found == max(asked, key=lambda clusters: clusters["view"])
