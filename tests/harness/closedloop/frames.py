"""Frames of a few vehicles for tests; the first is the ego."""

import numpy as np

from harness.truth.frame import Frame


def frame_of(lon, lat, speed=None, step=0, names=None, **columns):
    count = len(lon)
    values = {
        "heading_rad": np.zeros(count),
        "lat_speed_mps": np.zeros(count),
        "accel_mps2": np.zeros(count),
        "lane": np.ones(count, dtype=np.int64),
        "length_m": np.full(count, 4.5),
        "width_m": np.full(count, 1.8),
    } | {name: np.asarray(value) for name, value in columns.items()}
    return Frame(
        step=step,
        time_s=0.1 * step,
        episode=0,
        ego=0,
        vehicle_id=np.array(names or [f"v{k}" for k in range(count)]),
        lon_m=np.asarray(lon, dtype=np.float64),
        lat_m=np.asarray(lat, dtype=np.float64),
        speed_mps=np.full(count, 10.0) if speed is None else np.asarray(speed, dtype=np.float64),
        **values,
    )
