"""The tracks that a tracker reports after each scan."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from mmpf.numerics.arrays import FloatArray, IntArray

TENTATIVE, CONFIRMED, HIDDEN = range(3)
TRACK_STATES = ("tentative", "confirmed", "hidden")


@dataclass(frozen=True)
class Tracks:
    """The m tracks reported after one scan, struct of arrays, each of shape (m,), in the road frame.

    Attributes:
        track_id: Identity, stable from scan to scan and never used again.
        lon_m: Longitudinal position of the vehicle's centre, metres.
        lat_m: Lateral position of the vehicle's centre, metres.
        speed_mps: Longitudinal speed, m/s.
        lat_speed_mps: Lateral speed, m/s.
        accel_mps2: Longitudinal acceleration, m/s².
        std_lon_m: Standard deviation of the longitudinal position, metres.
        std_lat_m: Standard deviation of the lateral position, metres.
        std_speed_mps: Standard deviation of the longitudinal speed, m/s.
        existence: Probability that the track is a vehicle, 0 to 1.
        state: ``TENTATIVE``, ``CONFIRMED`` or ``HIDDEN`` (confirmed, and the tracker knows that it can't be seen).
    """

    track_id: IntArray
    lon_m: FloatArray
    lat_m: FloatArray
    speed_mps: FloatArray
    lat_speed_mps: FloatArray
    accel_mps2: FloatArray
    std_lon_m: FloatArray
    std_lat_m: FloatArray
    std_speed_mps: FloatArray
    existence: FloatArray
    state: npt.NDArray[np.int8]

    def __len__(self) -> int:
        return len(self.track_id)

    @classmethod
    def none(cls) -> Tracks:
        """Return an empty set of tracks."""
        empty = np.zeros(0)
        columns = {column.name: empty for column in fields(cls) if column.name not in {"track_id", "state"}}
        return cls(track_id=np.zeros(0, dtype=np.int64), state=np.zeros(0, dtype=np.int8), **columns)
