"""Bodies and egos for the tests of decisions."""

import numpy as np

from harness.decisions.bodies import Bodies, Egos

LENGTH_M, WIDTH_M = 4.0, 1.8


def egos(steps=1, lon=0.0, lat=1.83, speed=20.0, lane=5, episode=0) -> Egos:
    numbers = {"lon_m": lon, "lat_m": lat, "speed_mps": speed, "length_m": LENGTH_M, "width_m": WIDTH_M}
    columns = {name: np.full(steps, value, dtype=np.float64) for name, value in numbers.items()}
    return Egos(**columns, episode=np.full(steps, episode), lane=np.full(steps, lane))


def bodies(*rows, direction=0.0) -> Bodies:
    """Return bodies from rows of step, lon, lat and speed."""
    step, lon_m, lat_m, speed_mps = np.array(rows, dtype=np.float64).reshape(-1, 4).T
    others = (np.full(len(step), value) for value in (float(direction), LENGTH_M, WIDTH_M))
    return Bodies(step.astype(np.int64), lon_m, lat_m, speed_mps, *others)
