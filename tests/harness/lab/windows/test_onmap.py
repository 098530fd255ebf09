"""Recorded traffic on the lanes of a map: what is left of the lane, what comes next, who is free."""

import numpy as np

from harness.lab.windows.onmap import on_map
from harness.lab.windows.recording import Recording
from mmpf.map.lane_graph import NOWHERE
from tests.mmpf.map.scenes import graph_of

GRAPH = graph_of({"a": [(0.0, 0.0), (50.0, 0.0)], "b": [(50.0, 0.0), (200.0, 0.0)]}, [("a", "b")])


def traffic(x_m: dict[int, list[float]], speed_mps: float) -> Recording:
    """Return vehicles at x on the line, one row a step; vehicles are lines of ``x_m``."""
    rows = [(step, vehicle, x) for vehicle, places in x_m.items() for step, x in enumerate(places)]
    step, vehicle, x = (np.array(column) for column in zip(*rows, strict=True))
    order, n = np.argsort(step, kind="stable"), len(rows)
    lane, same = np.where(x < 50.0, 1, 2)[order], np.zeros(n)
    places = (x[order].astype(float), same)
    return Recording(step[order], vehicle[order], lane, *places, np.full(n, speed_mps), same, same, np.full(n, 4.0))


def test_a_vehicle_alone_is_free_and_the_lane_that_it_takes_is_the_next() -> None:
    moments = on_map(traffic({0: [40.0, 48.0, 56.0]}, 8.0), GRAPH)
    assert moments.lane.tolist() == [0, 0, 1]
    assert moments.following.tolist() == [1, 1, NOWHERE]
    assert moments.to_end_m.tolist() == [10.0, 2.0, 144.0]
    assert moments.free.all()


def test_a_leader_near_on_the_next_lane_holds_a_vehicle_and_one_far_off_does_not() -> None:
    behind = [40.0, 48.0, 56.0]
    near = on_map(traffic({0: behind, 1: [60.0, 68.0, 76.0]}, 8.0), GRAPH)
    far = on_map(traffic({0: behind, 1: [160.0, 168.0, 176.0]}, 8.0), GRAPH)
    assert near.free[near.driver == 0].tolist() == [False] * 3
    assert far.free.all()
