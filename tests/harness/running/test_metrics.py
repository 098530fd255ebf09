import json

import numpy as np
import pandas as pd
import pytest

from harness.common.numbers import as_json, without_nan
from harness.running.follow import StageTimes
from harness.running.metrics import TrafficSums, timing_table
from mmpf.map.corridor_road import highway
from mmpf.map.graph_road import LaneGraphRoad
from tests.mmpf.map.scenes import graph_of


def of_traffic(truth: pd.DataFrame) -> TrafficSums:
    sums = TrafficSums(highway(5))
    sums.add(truth)
    return sums


def row_of_cars(count: int, speed_mps: float, steps: int = 10) -> pd.DataFrame:
    """Return cars that are spread evenly over the section at every step."""
    lon = np.linspace(1.0, 639.0, count)
    return pd.DataFrame(
        {
            "step": np.repeat(np.arange(steps), count),
            "lon_m": np.tile(lon, steps),
            "speed_mps": speed_mps,
            "lane": 1,
            "is_ego": np.tile(np.arange(count) == 0, steps),
            "in_range": np.tile(np.abs(lon - lon[0]) < 100.0, steps),
        }
    )


def test_density_flow_and_speed_of_even_traffic():
    # 64 cars on 640 m of five lanes are 100 per km and 20 per km and lane; at 10 m/s 3600 pass in an hour.
    summary = of_traffic(row_of_cars(64, 10.0)).summary()
    assert summary["density_veh_per_km_lane"] == pytest.approx(20.0)
    assert summary["flow_veh_per_h"] == pytest.approx(3600.0)
    assert summary["mean_speed_mps"] == pytest.approx(10.0)


def test_vehicles_outside_the_section_do_not_count():
    table = row_of_cars(64, 10.0)
    outside = table.assign(lon_m=table["lon_m"] + 1000.0)
    both = pd.concat([table, outside])
    assert of_traffic(both).summary() == of_traffic(table).summary()
    assert of_traffic(outside).summary()["density_veh_per_km_lane"] == 0.0


def test_vehicles_on_a_ramp_beside_the_section_do_not_count():
    table = row_of_cars(64, 10.0)
    assert of_traffic(pd.concat([table, table.assign(lane=0)])).summary() == of_traffic(table).summary()


def test_in_the_plane_traffic_is_that_on_lanes_within_100_m_of_the_ego_paths_across_junctions_left_out():
    lines = {"on": [(10.0 * k, 0.0) for k in range(41)], "over": [(10.0 * k, 50.0) for k in range(41)]}
    graph = graph_of(lines, [], in_junction=("over",))
    lon, lat, lane = np.array([[200.0, 0.0, 1], [290.0, 0.0, 1], [301.0, 0.0, 1], [200.0, 50.0, 2], [210.0, 0.0, 0]]).T
    truth = pd.DataFrame(
        {"step": 0, "lon_m": lon, "lat_m": lat, "lane": lane, "speed_mps": 5.0, "is_ego": lon + lat == 200.0,
         "in_range": lon > 200.0}
    )  # fmt: skip
    sums = TrafficSums(LaneGraphRoad(graph))
    for step in (0, 1):
        sums.add(truth.assign(step=step))
    # The ego and the car 90 m ahead are on 200 m of lane.
    assert sums.table() == pytest.approx(
        {"density_veh_per_km_lane": 10.0, "flow_veh_per_h": 180.0, "mean_speed_mps": 5.0, "vehicles_in_range": 3.0}
    )


def test_real_time_factor_is_simulated_time_over_time_spent():
    times = StageTimes(truth_s=[0.03] * 10, sensor_s=[0.01] * 10, tracker_s=[0.02] * 10, waited_s=[0.03] * 10)
    table = timing_table(times, step_s=0.1, total_s=3.0)
    assert table["realtime_factor"] == pytest.approx(2.0)
    assert table["tracker_ms"]["p99"] == pytest.approx(20.0)
    assert (table["steps"], table["total_s"]) == (10, 3.0)


def test_json_has_no_nan_and_no_numpy():
    value = {"a": [np.float64("nan"), np.int64(3)], "b": float("inf"), "c": (np.bool_(True),)}
    assert json.loads(as_json(without_nan(value))) == {"a": [None, 3], "b": None, "c": [True]}
