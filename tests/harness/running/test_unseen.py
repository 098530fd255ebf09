"""What is kept of a run of where unseen vehicles are expected."""

import numpy as np
import pytest

from harness.running.snapshots import observe_traffic
from harness.running.unseen import UnseenKeeper
from harness.sensor.detector import build_sensor
from harness.sensor.profiles import sensor_settings
from mmpf.undetected.intensity import Unseen, UnseenTraffic
from mmpf.visibility.range_profile import Reach
from tests.harness.stand_ins import EchoTracker, SteadyTraffic, track


def kept(traffic: SteadyTraffic, build=EchoTracker):
    snapshots = observe_traffic(traffic, build_sensor(sensor_settings("lidar", {})), 0)
    keeper = UnseenKeeper(snapshots.road, snapshots.sensor)
    track(snapshots, build, 0, (keeper.watch,))
    return keeper, snapshots


def test_rows_stand_twice_a_second_and_for_stretches_that_are_in_range_from_end_to_end():
    keeper, snapshots = kept(SteadyTraffic(steps=21))
    table = keeper.table()
    assert np.unique(table["time_s"]) == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0])
    assert table["to_lon_m"].to_numpy() - table["from_lon_m"].to_numpy() == pytest.approx(25.0, abs=0.01)
    ego_lon_m = 20.0 * table["time_s"]
    for end in ("from_lon_m", "to_lon_m"):
        assert np.abs(table[end] - ego_lon_m).max() <= snapshots.sensor.range_m + 2.5
    assert set(table["from_lat_m"]) == set(table["to_lat_m"]) == {lane.centre_m for lane in snapshots.road.lanes}


def test_another_episode_begins_with_another_field():
    one, _ = kept(SteadyTraffic(steps=4))
    two, _ = kept(SteadyTraffic(steps=8, ego_stay=4))
    table = two.table()
    assert sorted(table["episode"].unique()) == [0, 1]
    assert sorted(table["step"].unique()) == [0, 4]
    first = table[table["episode"] == 0].reset_index(drop=True)
    assert first.equals(one.table())


def test_a_tracker_that_tells_it_itself_is_taken_at_its_word():
    class Knowing(EchoTracker):
        def step(self, scan):
            if not hasattr(self, "field"):
                self.field = UnseenTraffic(self.setting.road, self.setting.sensor)
            cells = self.field.step(scan, tracks := super().step(scan)).cells
            self.unseen = Unseen(cells, np.full(len(cells), 0.01))
            return tracks

    keeper, _ = kept(SteadyTraffic(steps=3), Knowing)
    assert keeper.table()["expected"].to_numpy() == pytest.approx(0.05)


def test_what_a_tracker_has_learned_of_its_sensors_reach_takes_the_data_sheets_place():
    class Learned(EchoTracker):
        reach = Reach(10.0, np.full(10, 1e6), np.full(10, 1e5))

    class OfAnotherKind(EchoTracker):
        reach = 80.0

    usual, _ = kept(SteadyTraffic(steps=11))
    learned, _ = kept(SteadyTraffic(steps=11), Learned)
    other, _ = kept(SteadyTraffic(steps=11), OfAnotherKind)
    assert learned.table()["expected"].sum() > 1.5 * usual.table()["expected"].sum()
    assert other.table().equals(usual.table())


def test_what_was_forgotten_is_not_there_again():
    keeper, _ = kept(SteadyTraffic(steps=3))
    keeper.forget()
    assert keeper.table() is None
