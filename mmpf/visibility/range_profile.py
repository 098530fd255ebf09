"""Detection probability in plain view at each distance, learned online because no data sheet states it for all.

A data sheet names one detection probability; real detectors find hardly any vehicle at the end of their range, and a
sheet may promise too much everywhere. Detections and scans in which one was to be expected are counted in rings around
the sensor, and slowly forgotten: the mean of a Beta distribution that begins at the data sheet's figure, as in
filters with an unknown detection profile (Mahler, Vo and Vo, IEEE TSP 2011), here one for the sensor in place of one
for each vehicle.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from mmpf.numerics.arrays import FloatArray

RINGS = 10
SHARE_BOUNDS = (0.05, 1.4)
AS_PROMISED = np.ones(RINGS)
PRIOR_SCANS = 20.0
"""Expected detections that the data sheet itself counts for, in each ring."""


@dataclass(frozen=True)
class Reach:
    """Detections at each distance relative to the data sheet.

    Attributes:
        ring_m: Width of a ring.
        expected: Detections that the data sheet lets expect, shape (rings,).
        detected: Detections that there were, shape (rings,).
    """

    ring_m: float
    expected: FloatArray
    detected: FloatArray

    @classmethod
    def of_data_sheet(cls, range_m: float) -> Self:
        """Return the initial counts: nothing contradicts the data sheet."""
        return cls(range_m / RINGS, np.zeros(RINGS), np.zeros(RINGS))

    def shares(self) -> FloatArray:
        """Return the detection probability over the data sheet's in each ring, shape (rings,)."""
        share = (self.detected + PRIOR_SCANS) / (self.expected + PRIOR_SCANS)
        return np.asarray(np.clip(share, *SHARE_BOUNDS))

    def after(self, distance_m: FloatArray, expected: FloatArray, detected: FloatArray, kept: float) -> Self:
        """Return the counts after a scan.

        Args:
            distance_m: Distances of the vehicles in plain view, shape (k,); those beyond the range count in the last
                ring.
            expected: Detections that the data sheet lets expect of each, shape (k,).
            detected: Detections of each, shape (k,).
            kept: Share of the former counts that is not forgotten.
        """
        ring = np.minimum((distance_m / self.ring_m).astype(np.int64), RINGS - 1)
        return type(self)(
            self.ring_m,
            kept * self.expected + np.bincount(ring, expected, RINGS),
            kept * self.detected + np.bincount(ring, detected, RINGS),
        )


def share_at(distance_m: FloatArray, shares: FloatArray, ring_m: float) -> FloatArray:
    """Return the share between the middles of the rings, linearly, shape (n,).

    Args:
        distance_m: Distances from the sensor, shape (n,).
        shares: The share in each ring, shape (rings,).
        ring_m: Width of a ring.
    """
    return np.interp(distance_m, (np.arange(len(shares)) + 0.5) * ring_m, shares)
