"""Bodies and egos for the tests of decisions."""

import numpy as np

from harness.decisions.bodies import Bodies, Egos

LENGTH_M, WIDTH_M = 4.0, 1.8


def egos(steps=1, lon=0.0, lat=1.83, speed=20.0, lane=5, episode=0) -> Egos:
    def filled(value, kind=np.float64):
        return np.broadcast_to(np.asarray(value, dtype=kind), steps).copy()

    return Egos(
        episode=filled(episode, np.int64),
        lon_m=filled(lon),
        lat_m=filled(lat),
        speed_mps=filled(speed),
        lane=filled(lane, np.int64),
        length_m=filled(LENGTH_M),
        width_m=filled(WIDTH_M),
    )


def bodies(*rows, direction=0.0) -> Bodies:
    """Return bodies from rows of step, lon, lat and speed."""
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    n = len(table)
    return Bodies(
        step=table[:, 0].astype(np.int64),
        lon_m=table[:, 1],
        lat_m=table[:, 2],
        speed_mps=table[:, 3],
        direction_rad=np.broadcast_to(np.float64(direction), n).copy(),
        length_m=np.full(n, LENGTH_M),
        width_m=np.full(n, WIDTH_M),
    )
