"""Progress, cancelling, and living beside other libraries."""

import threading

import nacre_native
import numpy as np
import pytest

ARGUMENTS = {"ranks": (6, 3, 4, 4), "iterations": 3}


@pytest.mark.parametrize("threads", [1, 2])
def test_progress_rises_to_one_on_the_calling_thread(samples, fit, threads):
    def follow(call):
        seen = []

        def progress(fraction, message):
            assert threading.current_thread() is threading.main_thread()
            seen.append((fraction, message))
            return True

        call(progress)
        fractions = [fraction for fraction, _ in seen]
        assert fractions == sorted(fractions) and fractions[0] == 0 and fractions[-1] == 1
        return {message for _, message in seen}

    messages = follow(lambda p: fit(progress=p, threads=threads, **ARGUMENTS))
    assert {"First clusters", "Iteration 1: clustering"} <= messages
    messages = follow(
        lambda p: nacre_native.fit_nsvd(samples, progress=p, threads=threads, **ARGUMENTS)
    )
    assert "N-SVD: iteration 1" in messages


@pytest.mark.parametrize("after", range(5))
def test_cancel(samples, fit, after):
    for call in (fit, lambda **k: nacre_native.fit_nsvd(samples, **k)):
        calls = []

        def progress(fraction, message, calls=calls):
            calls.append(fraction)
            return len(calls) <= after

        with pytest.raises(nacre_native.Cancelled):
            call(progress=progress, **ARGUMENTS)
        assert len(calls) == after + 1


def test_what_progress_raises_comes_out(fit):
    def progress(fraction, message):
        raise LookupError(message)

    with pytest.raises(LookupError, match="Global basis"):
        fit(progress=progress, **ARGUMENTS)


def test_progress_that_returns_nothing_goes_on(fit):
    assert fit(progress=lambda fraction, message: None, **ARGUMENTS)["iterations"] >= 1


def test_other_threads_run_meanwhile(samples):
    """The interpreter's lock is free during a fit: a fit in a thread does not stop this one."""
    large = np.tile(samples, (2, 2, 8, 8, 1))
    done = threading.Event()
    counted = []

    def fit():
        nacre_native.fit_nsvd(large, (12, 12, 16, 16), iterations=4, tolerance=0)
        done.set()

    thread = threading.Thread(target=fit)
    thread.start()
    while not done.is_set():
        counted.append(1)
        done.wait(0.001)
    thread.join()
    assert len(counted) > 3


def test_fits_in_several_threads_do_not_disturb_each_other(fit):
    alone = fit()["core"]
    results = [None] * 4

    def run(i):
        results[i] = fit(threads=2)["core"]

    threads = [threading.Thread(target=run, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for core in results:
        np.testing.assert_array_equal(core, alone)


def test_numpys_own_blas_is_left_alone(fit):
    """Both have an OpenBLAS of their own in the process; ours is set to one thread."""
    a = np.random.default_rng(0).random((200, 200))
    before = a @ a
    fit(**ARGUMENTS)
    np.testing.assert_array_equal(a @ a, before)
    np.testing.assert_allclose(np.linalg.inv(a) @ a, np.eye(200), atol=1e-8)
    with open("/proc/self/maps") as maps:
        libraries = {line.split()[-1] for line in maps if "openblas" in line}
    assert sum("libnacre_openblas" in path for path in libraries) == 1
