"""Which vehicle is the ego, and when another takes over."""

import numpy as np
import pytest

from harness.truth.sumo.corridor_traffic import choose_ego
from harness.truth.sumo.simulation import NO_EGO
from tests.harness.closedloop.frames import frame_of


def chosen(present, **vehicles):
    """Return who is the ego after another, of vehicles given as name=(lon, lane, length); None if nobody is."""
    lon, lane, length = np.array(list(vehicles.values()), dtype=float).T
    frame = frame_of(lon, 0.0 * lon, names=list(vehicles), lane=lane.astype(np.int64), length_m=length)
    row = choose_ego(frame, present, (2, 3, 4), (0.0, 640.0))
    return None if row is None else str(frame.vehicle_id[row])


NEAR = {"edge": (5, 1, 4.5), "truck": (10, 3, 15), "good": (40, 3, 4.5), "far": (300, 3, 4.5), "before": (-5, 3, 4.5)}
YOUNG = {"young": (10, 3, 4.5)}


@pytest.mark.parametrize(
    ("present", "vehicles", "ego"),
    [
        (NO_EGO, NEAR, "good"),
        ("old", {"old": (639.9, 1, 4.5)} | YOUNG, "old"),
        ("old", {"old": (640.0, 3, 4.5)} | YOUNG, "young"),
        ("old", {"old": (420.0, 0, 4.5)} | YOUNG, "young"),
        (NO_EGO, {"truck": (500, 5, 15)}, "truck"),
        (NO_EGO, {"before": (-5, 3, 4.5)}, None),
    ],
    ids=["a car near the start", "stays in the section", "past its end", "on a ramp", "no better one", "nobody"],
)
def test_the_ego_is_a_car_on_a_middle_lane_near_the_start_until_it_leaves(present, vehicles, ego):
    assert chosen(present, **vehicles) == ego
