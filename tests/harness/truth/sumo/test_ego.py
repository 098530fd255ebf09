"""Which vehicle is the ego, and when another takes over."""

import numpy as np

from harness.truth.frame import Frame
from harness.truth.sumo.simulation import NO_EGO, EgoChoice, choose_ego

SECTION = (0.0, 640.0)
NOBODY = EgoChoice(NO_EGO, -1)


def scene(**vehicles):
    """Return a frame of vehicles given as name=(lon, lane, length)."""
    rows = np.array(list(vehicles.values()), dtype=float).reshape(-1, 3)
    zeros = np.zeros(len(rows))
    return Frame(
        step=0,
        time_s=0.0,
        episode=0,
        ego=-1,
        vehicle_id=np.array(list(vehicles), dtype=np.str_),
        lon_m=rows[:, 0],
        lat_m=zeros,
        heading_rad=zeros,
        speed_mps=zeros,
        lat_speed_mps=zeros,
        accel_mps2=zeros,
        lane=rows[:, 1].astype(np.int64),
        length_m=rows[:, 2],
        width_m=zeros + 1.8,
    )


def test_a_car_on_a_middle_lane_near_the_start_is_chosen():
    frame = scene(edge=(5, 1, 4.5), truck=(10, 3, 15), far=(300, 3, 4.5), good=(40, 3, 4.5), before=(-5, 3, 4.5))
    assert choose_ego(frame, NOBODY, (2, 3, 4), SECTION) == EgoChoice("good", 0)


def test_the_ego_stays_as_long_as_it_is_in_the_section():
    frame = scene(old=(639.9, 1, 4.5), young=(10, 3, 4.5))
    assert choose_ego(frame, EgoChoice("old", 2), (2, 3, 4), SECTION) == EgoChoice("old", 2)


def test_another_takes_over_when_the_ego_passes_the_end_or_leaves_by_a_ramp():
    passed = scene(old=(640.0, 3, 4.5), young=(10, 3, 4.5))
    left = scene(old=(420.0, 0, 4.5), young=(10, 3, 4.5))
    for frame in (passed, left):
        assert choose_ego(frame, EgoChoice("old", 2), (2, 3, 4), SECTION) == EgoChoice("young", 3)


def test_any_vehicle_in_the_section_will_do_if_there_is_no_better():
    assert choose_ego(scene(truck=(500, 5, 15)), NOBODY, (2, 3, 4), SECTION).vehicle_id == "truck"


def test_an_empty_section_has_no_ego():
    assert choose_ego(scene(before=(-5, 3, 4.5)), NOBODY, (2, 3, 4), SECTION).vehicle_id == NO_EGO


def test_the_frame_points_at_the_chosen_vehicle():
    frame = EgoChoice("b", 4).apply(scene(a=(1, 2, 4.5), b=(2, 3, 4.5)))
    assert (frame.vehicle_id[frame.ego], frame.episode) == ("b", 4)
