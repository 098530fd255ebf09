"""Work shared out to several cores covers everything once, and changes no byte of the result."""

import numpy as np
import pytest

from mmpf.motion import motion_model
from mmpf.numerics.threads import in_shares, threads
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
