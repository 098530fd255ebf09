"""Samples of what vehicles do, from frames with known answers."""

import numpy as np
import pytest

from harness.lab.fidelity.samples import UNITS, BehaviourSamples, VehicleStatistics, merged, samples_of
from tests.harness.closedloop.frames import frame_of

STEP_S = 0.1
WINDOW = (0.0, 1000.0)


def frame(step, vehicles):
    """Make a frame of rows (name, lon, speed, lane, lateral speed)."""
    names, lon, speed, lane, drift = (list(column) for column in zip(*vehicles, strict=True))
    zeros = np.zeros(len(names))
    more = {"lat_speed_mps": np.array(drift, dtype=float), "accel_mps2": zeros + 0.5, "width_m": zeros + 1.9}
    return frame_of(lon, zeros, speed, step, names, lane=lane, **more)


def taken_from(frames):
    return samples_of(frames, WINDOW, STEP_S)


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (
            [("a", 100.0, 10.0, 1, 0.0), ("b", 130.0, 12.0, 1, 0.0), ("c", 110.0, 9.0, 2, 0.0)],
            {"space_headway": [30.0], "time_headway": [3.0]},
        ),
        ([("a", 100.0, 0.5, 1, 0.0), ("b", 108.0, 0.5, 1, 0.0)], {"space_headway": [8.0], "time_headway": []}),
        (
            [
                ("a", 5.0, 10.0, 1, 0.0),
                ("b", 995.0, 10.0, 1, 0.0),
                ("c", 500.0, 10.0, 0, 0.0),
                ("d", 500.0, 7.0, 3, 0.0),
            ],
            {"speed": [7.0], "vehicle_length": [4.5]},
        ),
    ],
    ids=["followers on one lane", "standing followers have no time headway", "near the ends and off the lanes"],
)
def test_headways_speeds_and_lengths_are_of_vehicles_on_lanes_within_the_window(rows, told):
    values = taken_from([frame(0, rows)]).by_quantity
    assert {name: values[name].tolist() for name in told} == told


def change(towards, steps=60, begin=20, end=50, switch=35):
    """Return a vehicle that drifts from step ``begin`` to ``end`` and is on its new lane from ``switch`` on."""
    return [
        frame(k, [("a", 100.0 + k, 10.0, 3 if k < switch else 3 - towards, towards * 0.8 * (begin <= k < end))])
        for k in range(steps)
    ]


@pytest.mark.parametrize("towards", [1, -1])
def test_a_lane_change_lasts_from_the_begin_to_the_end_of_the_drift(towards):
    taken = taken_from(change(towards))
    assert taken.lane_changes == 1
    assert taken.by_quantity["lane_change_duration"][0] == pytest.approx(3.0, abs=0.15)
    assert taken.changes_per_km == pytest.approx(1.0 / 0.06, rel=1e-6)


def test_two_vehicles_that_follow_each_other_in_the_list_make_no_lane_change():
    frames = [frame(k, [("a", 100.0, 5.0, 1, 0.0), ("b", 200.0, 5.0, 2, 0.0)]) for k in range(20)]
    assert taken_from(frames).lane_changes == 0


def test_each_vehicle_is_measured_once_and_merged_samples_add_up():
    one = taken_from(change(1))
    both = merged([one, taken_from(change(-1))])
    assert len(one.by_quantity["vehicle_width"]) == 1
    assert len(both.by_quantity["speed"]) == 2 * len(one.by_quantity["speed"])
    assert both.lane_changes == 2
    assert both.changes_per_km == pytest.approx(one.changes_per_km)


def test_no_frames_give_no_samples():
    taken = taken_from([])
    assert taken.lane_changes == 0
    assert np.isnan(taken.changes_per_km)
    assert all(len(values) == 0 for values in taken.by_quantity.values())


def test_the_spread_of_accelerations_does_not_depend_on_their_mean():
    values = {name: np.zeros(0) for name in UNITS} | {"acceleration": np.array([1.0, 1.0, 3.0, 3.0])}
    assert BehaviourSamples(values, 4, 5.0).statistics() == VehicleStatistics(0.8, 1.0)
