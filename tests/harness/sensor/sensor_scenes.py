"""Tiny frames on a straight road for the tests of the sensor."""

import numpy as np

from harness.truth.frame import Frame
from mmpf.map.corridor_road import highway

ROAD = highway()
MIDDLE = 2.5 * 3.66


def frame_of(*cars, ego_lon=300.0, heading=0.0, ego_speed=20.0):
    """Return a frame of the ego in the middle lane and cars given as (metres ahead, metres to the left[, speed])."""
    rows = np.array([(0.0, 0.0, ego_speed)] + [(*car, 20.0)[:3] for car in cars])
    count = len(rows)
    return Frame(
        step=0,
        time_s=0.0,
        episode=0,
        ego=0,
        vehicle_id=np.array(["ego"] + [f"car{i}" for i in range(1, count)]),
        lon_m=ego_lon + rows[:, 0],
        lat_m=MIDDLE + rows[:, 1],
        heading_rad=np.full(count, heading),
        speed_mps=rows[:, 2],
        lat_speed_mps=np.zeros(count),
        accel_mps2=np.zeros(count),
        lane=np.full(count, 3),
        length_m=np.full(count, 4.7),
        width_m=np.full(count, 1.9),
    )
