"""Which vehicle is the ego, and when another takes over."""

import numpy as np

from harness.truth.sumo.corridor_traffic import choose_ego
from harness.truth.sumo.simulation import NO_EGO
from tests.harness.closedloop.frames import frame_of


def chosen(present, **vehicles):
    """Return who is the ego after another, of vehicles given as name=(lon, lane, length); None if nobody is."""
    lon, lane, length = np.array(list(vehicles.values()), dtype=float).T
    frame = frame_of(lon, 0.0 * lon, names=list(vehicles), lane=lane.astype(np.int64), length_m=length)
    row = choose_ego(frame, present, (2, 3, 4), (0.0, 640.0))
    return None if row is None else str(frame.vehicle_id[row])


def test_a_car_on_a_middle_lane_near_the_start_is_chosen():
    near = {"edge": (5, 1, 4.5), "truck": (10, 3, 15), "good": (40, 3, 4.5)}
    assert chosen(NO_EGO, **near, far=(300, 3, 4.5), before=(-5, 3, 4.5)) == "good"


def test_the_ego_stays_as_long_as_it_is_in_the_section():
    assert chosen("old", old=(639.9, 1, 4.5), young=(10, 3, 4.5)) == "old"


def test_another_takes_over_when_the_ego_passes_the_end_or_leaves_by_a_ramp():
    assert chosen("old", old=(640.0, 3, 4.5), young=(10, 3, 4.5)) == "young"
    assert chosen("old", old=(420.0, 0, 4.5), young=(10, 3, 4.5)) == "young"


def test_any_vehicle_in_the_section_will_do_if_there_is_no_better():
    assert chosen(NO_EGO, truck=(500, 5, 15)) == "truck"


def test_an_empty_section_has_no_ego():
    assert chosen(NO_EGO, before=(-5, 3, 4.5)) is None
