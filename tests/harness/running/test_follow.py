from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from harness.running.follow import StageTimes, follow
from harness.running.recorder import ColumnRecorder
from harness.running.snapshots import RandomStreams, observe_traffic
from harness.sensor.detector import build_sensor
from harness.sensor.profiles import sensor_settings
from harness.trackers.protocol import TrackerSetting
from tests.harness.stand_ins import EchoTracker, SteadyTraffic, track


def drive(traffic: SteadyTraffic, seed: int = 0, build=EchoTracker, profile: str = "lidar") -> SimpleNamespace:
    return track(observe_traffic(traffic, build_sensor(sensor_settings(profile, {})), seed), build, seed)


def test_another_tracker_leaves_truth_and_detections_as_they_were():
    class Greedy(EchoTracker):
        def step(self, scan):
            self.setting.rng.standard_normal(1000)
            return super().step(scan)

    one, other = drive(SteadyTraffic()), drive(SteadyTraffic(), build=Greedy)
    assert one.truth.equals(other.truth)
    assert one.detections.equals(other.detections)
    assert not one.tracks.equals(other.tracks)


def test_another_seed_changes_the_detections_but_not_this_traffic():
    one, other = drive(SteadyTraffic(), seed=1), drive(SteadyTraffic(), seed=2)
    assert one.truth.equals(other.truth)
    assert not one.detections.equals(other.detections)


def test_each_episode_gets_a_new_tracker_with_its_own_stream_and_new_identities_however_few_bits_they_have():
    built = []

    class Narrow(EchoTracker):
        def step(self, scan):
            tracks = super().step(scan)
            return replace(tracks, track_id=tracks.track_id.astype(np.uint8))

    def build(setting: TrackerSetting) -> EchoTracker:
        built.append(setting)
        return Narrow(setting)

    tables = drive(SteadyTraffic(steps=30, ego_stay=10), build=build)
    assert sorted(tables.truth["episode"].unique()) == [0, 1, 2]
    # The first tracker is a rehearsal that compiles kernels and is thrown away.
    assert len(built) == 4
    draws = [setting.rng.random() for setting in built]
    assert len(set(draws)) == 4
    assert tables.tracks["track_id"].is_unique
    assert tables.tracks["track_id"].min() == 0  # the rehearsal has used up none


def test_a_tracker_that_is_told_the_origins_gets_the_true_names():
    class Told:
        names: set[str] = set()  # noqa: RUF012

        def __init__(self, setting):
            self.echo = EchoTracker(setting)

        def step_associated(self, scan, truth_id):
            assert truth_id.shape == scan.detections.lon_m.shape
            Told.names |= set(truth_id.tolist())
            return self.echo.step(scan)

    drive(SteadyTraffic(), build=Told)
    assert Told.names - {""} <= {f"car{k}" for k in range(18)}
    assert len(Told.names) > 3


SIZE_COLUMNS = ["length_m", "width_m", "std_length_m", "std_width_m"]


@pytest.mark.parametrize("profile", ["lidar", "camera", "radar"])
def test_detections_have_columns_of_size_only_if_the_sensor_measures_sizes(profile):
    recorded = drive(SteadyTraffic(steps=3), profile=profile).detections
    assert [name for name in recorded.columns if name in SIZE_COLUMNS] == ([] if profile == "radar" else SIZE_COLUMNS)


def test_a_step_that_was_cut_short_is_left_out():
    snapshots = observe_traffic(SteadyTraffic(steps=9, fail_at=5), build_sensor(sensor_settings("lidar", {})), 0)
    recorder = ColumnRecorder()
    with pytest.raises(RuntimeError, match="broke"):
        follow(snapshots, EchoTracker, recorder, RandomStreams.from_seed(0).tracker, (), StageTimes())
    recorder._columns["truth.parquet"].append(recorder._columns["truth.parquet"][-1])
    truth = recorder.tables()["truth.parquet"]
    assert_array_equal(np.unique(truth["step"]), np.arange(5))
    assert len(truth) == 5 * 18
