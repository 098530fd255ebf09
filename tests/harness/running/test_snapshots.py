"""Snapshots are made when they are asked for, or kept to be played again and again."""

import os
import signal
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import RunError, SumoError
from harness.config.model import RunConfig
from harness.running.follow import StageTimes
from harness.running.snapshots import SnapshotStream
from tests.harness.stand_ins import EchoTracker, SteadyTraffic, observing, track

pytestmark = pytest.mark.forks


def snapshots_from(traffic: SteadyTraffic) -> SnapshotStream:
    return observing(traffic)(RunConfig())


def test_nothing_is_simulated_before_it_is_looked_at():
    snapshots = snapshots_from(SteadyTraffic(fail_at=3))
    assert [next(iter(snapshots)).frame.step for _ in range(3)] == [0, 1, 2]
    with pytest.raises(RuntimeError, match="broke"):
        next(iter(snapshots))


def test_kept_snapshots_and_those_made_ahead_are_the_live_ones_and_the_traffic_is_closed():
    for made in (SnapshotStream.kept, SnapshotStream.made_ahead):
        traffic = SteadyTraffic(steps=20)
        stream = made(snapshots_from(traffic))
        assert stream.expected_steps == 20
        for live, again in zip(snapshots_from(SteadyTraffic(steps=20)), stream, strict=True):
            assert live.frame.lon_m.tobytes() == again.frame.lon_m.tobytes()
            assert live.observation.scan.detections.lon_m.tobytes() == again.observation.scan.detections.lon_m.tobytes()
        if made is SnapshotStream.made_ahead:
            stream.close()
        assert traffic.closed


@pytest.mark.parametrize("broken", [RuntimeError("the traffic broke"), SumoError("the traffic broke")])
def test_what_breaks_ahead_is_told_after_the_snapshots_before_it(broken):
    def breaking():
        yield from snapshots_from(SteadyTraffic(steps=3))
        raise broken

    stream = iter(replace(snapshots_from(SteadyTraffic()), stream=breaking()).made_ahead())
    assert [next(stream).frame.step for _ in range(3)] == [0, 1, 2]
    with pytest.raises(RunError, match="the traffic broke"):
        next(stream)


def test_no_process_is_left_of_snapshots_that_are_closed_early_or_were_killed():
    before = children()
    endless = snapshots_from(SteadyTraffic(steps=10**9)).made_ahead()
    assert next(iter(endless)).frame.step == 0
    endless.close()
    killed = replace(endless, stream=(os.kill(os.getpid(), signal.SIGKILL) for _ in range(1))).made_ahead()
    with pytest.raises(RunError, match="SIGKILL"):
        next(iter(killed))
    assert children() <= before


def children() -> set[str]:
    return set(Path(f"/proc/self/task/{threading.get_native_id()}/children").read_text().split())


def test_every_tracker_that_kept_snapshots_are_played_to_gets_all_of_them():
    kept = snapshots_from(SteadyTraffic(steps=5)).kept()
    first, second = (track(kept, EchoTracker, seed=3) for _ in range(2))
    assert list(np.unique(first.truth["step"])) == list(range(5))
    for table in ("truth", "detections", "tracks"):
        assert getattr(first, table).equals(getattr(second, table))


def test_making_live_snapshots_takes_time_and_playing_kept_ones_none():
    live, kept = StageTimes(), StageTimes()
    track(snapshots_from(SteadyTraffic(steps=4)), EchoTracker, 0, times=live)
    track(snapshots_from(SteadyTraffic(steps=4)).kept(), EchoTracker, 0, times=kept)
    assert min(live.truth_s + live.sensor_s + live.tracker_s + kept.tracker_s) > 0.0
    assert list(kept.truth_s) == list(kept.sensor_s) == [0.0] * 4


@pytest.mark.parametrize(("steps", "fail_at", "error"), [(0, None, RunError), (5, 2, RuntimeError)])
def test_traffic_without_ego_or_that_breaks_is_closed_and_told(steps, fail_at, error):
    traffic = SteadyTraffic(steps=steps, fail_at=fail_at)
    with pytest.raises(error):
        snapshots_from(traffic).kept()
    assert traffic.closed
