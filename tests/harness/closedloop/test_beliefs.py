"""What the driver takes for real."""

import numpy as np
import pandas as pd
import pytest

from harness.closedloop.beliefs import TrackedPerception
from harness.running.recorder import ColumnRecorder
from harness.scoring.driving.believed import egos_of, tracked_bodies
from harness.scoring.evidence.rows import read_run
from harness.scoring.evidence.rules import DRIVER_EXISTENCE
from harness.sensor.detector import build_sensor
from harness.sensor.observation import Snapshot
from harness.sensor.profiles import sensor_settings
from mmpf.map.corridor_road import highway
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import without_map
from mmpf.tracks import CONFIRMED, TENTATIVE
from tests.harness.closedloop.frames import frame_of
from tests.mmpf.scenes import tracks_of

ROAD = highway()


@pytest.mark.parametrize("in_plane", [False, True])
def test_step_by_step_tracks_are_the_bodies_that_the_scores_make_of_the_finished_run(in_plane):
    rng, road = np.random.default_rng(5), LaneGraphRoad(without_map()) if in_plane else ROAD
    settings = sensor_settings("lidar", {})
    sensor, recorder, perception = build_sensor(settings), ColumnRecorder(), TrackedPerception(road)
    found = []
    for step in range(25):
        lon = np.array([0.0, 18.0, 30.0, -20.0, 45.0]) + 0.8 * step
        direction = {"direction_rad": np.zeros(5)} if in_plane else {}
        frame = frame_of(lon, [1.8, 1.8, 5.4, 5.4, 9.0], step=step, length_m=[4.5, 4.0, 5.5, 4.2, 9.0], **direction)
        snapshot = Snapshot(frame, sensor.observe(frame, ROAD, rng))
        tracks = tracks_of(
            lon[1:] + rng.normal(0.0, 0.3, 4), frame.lat_m[1:],
            speed_mps=np.nan if step % 7 == 0 else 8.0, existence=[0.9, 0.4, 0.8, 1.0],
            state=[CONFIRMED, CONFIRMED, TENTATIVE, CONFIRMED],
        )  # fmt: skip
        recorder.add(snapshot, tracks)
        bodies = perception.bodies(snapshot, tracks)
        assert bodies.doubtful.tolist() == [False, True, False]
        found.append(bodies.sure())
    truth, detections, told = recorder.tables().values()
    rows = read_run(truth, detections, told)
    egos, _ = egos_of(truth, rows)
    whole = tracked_bodies(detections, rows, egos, road)
    kept = rows.tracks.existence >= DRIVER_EXISTENCE
    for name in ("lon_m", "lat_m", "speed_mps", "length_m", "width_m", "direction_rad"):
        expected = pd.Series(getattr(whole, name)[kept]).groupby(whole.step[kept]).apply(sorted)
        for step, bodies in enumerate(found):
            there = sorted(getattr(bodies, name))
            assert there == pytest.approx(expected[step], abs=2e-3 if name[0] == "d" else 2e-4, nan_ok=True), name
