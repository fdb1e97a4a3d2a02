"""Checkpoints, and bounded memory: neither changes a bit of the result."""

import numpy as np
import pytest

from .models import assert_same

CASES = {
    "K-CTA": {},
    "K-CTA without global bases": {"global_modes": ()},
    "MK-CTA": {
        "ranks": (3, 3, 4, 4),
        "clusters": {0: 3, 1: 4},
        "mixtures": {0: 2, 1: 2},
        "global_modes": (2, 3),
    },
    "MK-CTA, greedy": {
        "ranks": (3, 2, 2, 4),
        "clusters": {0: 3, 1: 5, 2: 2},
        "mixtures": {0: 2, 1: 3, 2: 1},
        "global_modes": (3,),
        "search": "greedy",
    },
}


def through_a_file(state, path):
    """A state as it comes back from a file."""
    arrays = {f"basis_{n}": basis for n, basis in enumerate(state["basis"])}
    arrays |= {f"members_{mode}": members for mode, members in state["members"].items()}
    rest = {name: state[name] for name in ("core", "errors", "squared_norm")}
    np.savez(path, **arrays, **rest)
    with np.load(path) as file:
        return {
            "basis": [file[f"basis_{n}"] for n in range(4)],
            "members": {mode: file[f"members_{mode}"] for mode in state["members"]},
            **{name: file[name] for name in rest},
        }


@pytest.mark.parametrize("case", CASES)
def test_a_fit_ends_the_same_from_each_of_its_checkpoints(fit, tmp_path, case):
    states = []
    alone = fit(**CASES[case], iterations=12)
    whole = fit(**CASES[case], iterations=12, checkpoint=states.append)
    assert_same(alone, whole)
    # One with the global bases alone if there are any, and one before each iteration.
    has_global_bases = CASES[case].get("global_modes", (0,)) != ()
    counts = [len(state["errors"]) for state in states]
    assert counts[:2] == ([0, 1] if has_global_bases else [1, 2])
    assert counts[-1] >= 4 and counts == sorted(counts)
    for state in states:
        start = through_a_file(state, tmp_path / "state.npz")
        assert_same(fit(**CASES[case], iterations=12, start=start), whole)


def test_a_fit_that_is_interrupted_again_and_again(fit):
    """Each run does one iteration more and stops."""
    whole = fit(**CASES["MK-CTA"], iterations=8)

    class Enough(Exception):
        pass

    state = None
    for _ in range(20):
        states = []

        def stop(found, states=states):
            states.append(found)
            if len(states) == 2:
                raise Enough

        try:
            ended = fit(**CASES["MK-CTA"], iterations=8, start=state, checkpoint=stop)
            break
        except Enough:
            state = states[-1]
    assert_same(ended, whole)


def test_a_finished_model_may_be_refined(fit):
    """With its errors it goes on; without them they are computed."""
    model = fit(iterations=2, tolerance=0)
    more = fit(start=model, iterations=6, tolerance=0)
    assert more["errors"][:3] == model["errors"] and len(more["errors"]) > 3
    assert_same(more, fit(iterations=6, tolerance=0))
    again = fit(start=model | {"errors": []}, iterations=1, tolerance=0)
    assert again["errors"][0] == pytest.approx(model["errors"][-1], rel=1e-4)
    assert again["errors"][1] == pytest.approx(more["errors"][3], rel=1e-4)


@pytest.mark.parametrize("case", CASES)
def test_bounded_memory_changes_nothing(fit, tmp_path, case):
    """With one byte every large tensor lives in a file, which nobody sees."""
    bounded = fit(**CASES[case], memory=1, scratch=str(tmp_path))
    assert_same(bounded, fit(**CASES[case]))
    assert_same(bounded, fit(**CASES[case], memory=1 << 40, scratch=str(tmp_path)))
    assert [*tmp_path.iterdir()] == []
    states = []
    fit(**CASES[case], memory=1, scratch=str(tmp_path), checkpoint=states.append)
    assert_same(fit(**CASES[case], start=states[2]), bounded)


def test_bounded_memory_needs_a_folder(fit, tmp_path):
    """So files were used above."""
    with pytest.raises((OSError, RuntimeError), match="nowhere"):
        fit(memory=1, scratch=str(tmp_path / "nowhere"))
