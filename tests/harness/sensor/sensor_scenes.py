"""Tiny frames on a straight road for the tests of the sensor."""

import numpy as np

from mmpf.map.corridor_road import highway
from tests.harness.closedloop.frames import frame_of as frame_of_cars

ROAD = highway()
MIDDLE = 2.5 * 3.66


def frame_of(*cars, ego_lon=300.0, heading=0.0, ego_speed=20.0):
    """Return a frame of the ego in the middle lane and cars given as (metres ahead, metres to the left[, speed])."""
    rows = np.array([(0.0, 0.0, ego_speed)] + [(*car, 20.0)[:3] for car in cars])
    count = len(rows)
    return frame_of_cars(
        ego_lon + rows[:, 0],
        MIDDLE + rows[:, 1],
        rows[:, 2],
        names=["ego"] + [f"car{i}" for i in range(1, count)],
        heading_rad=np.full(count, heading),
        lane=np.full(count, 3),
        length_m=np.full(count, 4.7),
        width_m=np.full(count, 1.9),
    )
