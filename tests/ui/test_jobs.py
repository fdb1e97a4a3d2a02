"""A job runs on its thread, tells how far it is, and ends when asked."""

import threading
import time

import pytest

from addon import jobs
from addon.errors import Cancelled, NacreError


def finished(work):
    job = jobs.Job(work, "nacre.test")
    job.start()
    job.join(10)
    return job


def wait_until(condition):
    end = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


@pytest.fixture
def endless():
    """A job that goes on until it is cancelled."""

    def work(progress):
        while progress(0.25, "Waiting"):
            time.sleep(0.002)
        raise Cancelled

    job = jobs.Job(work, "nacre.test")
    job.start()
    wait_until(lambda: job.message)
    yield job
    job.cancel()
    job.join()


def test_the_result_of_the_work():
    job = finished(lambda progress: progress(1.0, "Ready") and threading.current_thread())
    assert job.done
    assert job.result is job
    assert job.error is None
    assert (job.fraction, job.message) == (1.0, "Ready")


def test_an_error_is_kept_for_the_main_thread():
    error = NacreError("no such file")

    def work(progress):
        raise error

    job = finished(work)
    assert job.done
    assert job.error is error


def test_a_job_that_has_not_begun_is_not_done():
    assert not jobs.Job(lambda progress: None).done
    assert jobs.running() is None


def test_the_fraction_stays_within_its_range():
    assert finished(lambda progress: progress(1.5, "")).fraction == 1.0
    assert finished(lambda progress: progress(-0.5, "")).fraction == 0.0


def test_the_running_job_is_found(endless):
    assert jobs.running() is endless
    assert endless.owner == "nacre.test"
    endless.cancel()
    endless.join()
    assert jobs.running() is None


def test_cancelling_ends_the_work(endless):
    assert not endless.done
    endless.cancel()
    assert endless.cancelled
    assert endless.text() == "Cancelling"
    endless.join(10)
    assert isinstance(endless.error, Cancelled)


def test_stopping_waits_for_the_end(endless):
    jobs.stop()
    assert endless.done
    jobs.stop()


def test_the_time_left_follows_the_pace(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(jobs.time, "monotonic", lambda: now[0])
    job = jobs.Job(lambda progress: None)
    assert job.seconds_left is None
    assert job.text() == "0%"
    now[0] += 10.0
    assert job.seconds_left is None, "nothing is known before the first progress"
    job._progress(0.2, "Reading")
    assert job.seconds_left == pytest.approx(40.0)
    assert job.text() == "20%, 40 s left"
    now[0] += 10.0
    job._progress(0.1, "Reading")
    assert job.text() == "10%, 3 min left"
    job._progress(1.0, "Reading")
    assert job.seconds_left == 0.0
