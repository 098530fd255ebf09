"""Work shared out to several cores covers everything once, and changes no byte of the result."""

from __future__ import annotations

import re

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from mmpf.motion import motion_model
from mmpf.numerics.threads import in_shares, one_blas_thread, threads
from mmpf.scan import SensorModel
from mmpf.tracker import MixtureTracker
from tests.mmpf.scenes import ROAD, ego_at, lane_centre, scan_of


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
@pytest.mark.parametrize("size", [0, 1, 5000, 20_001])
def test_every_element_is_worked_on_once(monkeypatch, threads, size):
    monkeypatch.setenv("MMPF_THREADS", str(threads))
    times = np.zeros(size, dtype=np.int64)

    def work(begin: int, end: int) -> None:
        assert begin % 128 == 0
        times[begin:end] += 1

    in_shares(work, size, block=128)
    assert (times == 1).all()


def test_one_thread_works_unless_more_are_asked_for(monkeypatch):
    monkeypatch.delenv("MMPF_THREADS", raising=False)
    assert threads() == 1
    monkeypatch.setenv("MMPF_THREADS", "64")
    assert threads() == 4
    monkeypatch.setenv("MMPF_THREADS", "many")
    with pytest.warns(UserWarning, match="MMPF_THREADS=many is not a number from 1 to 4"):
        assert threads() == 1


def blas_threads() -> set[int]:
    """Threads of the libraries that the filter's products are made by: SUMO brings others, which it never calls."""
    blas = [library for library in threadpool_info() if library["user_api"] == "blas"]
    return {library["num_threads"] for library in blas if re.search("numpy[.]libs", library["filepath"])}


def test_linear_algebra_is_held_to_one_thread_and_then_given_back():
    with threadpool_limits(limits=2, user_api="blas"):
        before = blas_threads()
        with one_blas_thread():
            assert blas_threads() == {1}
        assert blas_threads() == before


def test_a_step_holds_linear_algebra_to_one_thread_whatever_its_caller_does(monkeypatch):
    held = []
    monkeypatch.setattr("mmpf.tracker.check_scan", lambda *_: held.append(blas_threads()))
    tracker = MixtureTracker(ROAD, SensorModel(), motion_model("cvm"), np.random.default_rng(1))
    with threadpool_limits(limits=2, user_api="blas"):
        tracker.step(scan_of(0.0, [(0.0, lane_centre(2))], ego_at(0.0)))
        assert blas_threads() == {2}
    assert held == [{1}]


def test_an_error_in_one_share_is_raised(monkeypatch):
    monkeypatch.setenv("MMPF_THREADS", "2")

    def work(begin: int, _end: int) -> None:
        if begin:
            raise ArithmeticError

    with pytest.raises(ArithmeticError):
        in_shares(work, 20_000)


def test_tracks_are_the_same_bytes_with_one_thread_and_with_several(monkeypatch):
    places = [(15.0 * k - 90.0, lane_centre(k % 5)) for k in range(12)]
    scans = [
        scan_of(0.1 * step, [(lon + 1.5 * step, lat) for lon, lat in places], ego_at(1.5 * step)) for step in range(6)
    ]

    def tracked(threads: int) -> bytes:
        monkeypatch.setenv("MMPF_THREADS", str(threads))
        tracker = MixtureTracker(ROAD, SensorModel(), motion_model("gmm"), np.random.default_rng(1))
        for scan in scans:
            tracker.step(scan)
        assert len(tracker.mixture) >= len(places)
        return tracker.mixture.cloud.state.tobytes()

    assert tracked(1) == tracked(2) == tracked(3)
