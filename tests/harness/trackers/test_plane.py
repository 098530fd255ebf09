"""Rivals and the oracle in the plane: vehicles of any direction are followed, with speeds along their way."""

import numpy as np
import pytest

from harness.trackers.catalogue import build_tracker
from harness.trackers.protocol import TrackerSetting, step_tracker
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.scan import Detections, EgoPose, Scan, SensorModel
from tests.mmpf.map.scenes import graph_of

ROAD = LaneGraphRoad(graph=graph_of({"a": [(-100.0, 0.0), (100.0, 0.0)]}))
DIRECTIONS = np.radians([0.0, 90.0, 180.0, 250.0])
SPEED_MPS = 12.0


@pytest.mark.parametrize(
    "name", ["oracle-kalman", "stonesoup-gnn", "stonesoup-jpda", "immortal-kalman", "box-kalman", "oc-sort", "pmbm"]
)
@pytest.mark.parametrize("with_speed", [False, True])
def test_vehicles_of_all_directions_have_their_own_speed(name, with_speed):
    rng = np.random.default_rng(0)
    tracker = build_tracker(name, TrackerSetting(ROAD, SensorModel(), np.random.default_rng(1)), {})
    ids = np.array(list("abcd"))
    for k in range(40):
        time_s = 0.1 * k
        away = SPEED_MPS * (time_s - 2.0)
        x = 30.0 * np.cos(DIRECTIONS + 1.0) + away * np.cos(DIRECTIONS) + 0.2 * rng.standard_normal(4)
        y = 30.0 * np.sin(DIRECTIONS + 1.0) + away * np.sin(DIRECTIONS) + 0.2 * rng.standard_normal(4)
        speed = np.full(4, SPEED_MPS if with_speed else np.nan)
        detections = Detections(x, y, speed, np.full(4, 0.2), np.full(4, 0.2), 0.01 * speed)
        tracks = step_tracker(tracker, Scan(time_s, detections, EgoPose(0.0, 0.0, 0.0, 15.0, 4.7, 1.9)), ids)
    assert len(tracks) == 4
    assert tracks.speed_mps == pytest.approx(SPEED_MPS, abs=1.0)
    assert not tracks.lat_speed_mps.any()
