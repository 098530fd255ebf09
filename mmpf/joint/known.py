"""What the joint rule has learned about the sensor and the sources from the scans so far."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from mmpf.joint.false_objects import FalseObjects
from mmpf.joint.sources import Sources
from mmpf.numerics.arrays import BoolArray
from mmpf.scan import SensorModel
from mmpf.visibility.range_profile import Reach

# A single detection is no object that stays.
FEWEST_FALSE_HITS = 2


@dataclass(frozen=True)
class Known:
    """The learned state before a scan.

    Attributes:
        sensor: The sensor's data sheet, with the clutter that was counted.
        reach: How well the sensor sees at each distance.
        false_objects: What false objects, and vehicles, are like.
    """

    sensor: SensorModel
    reach: Reach
    false_objects: FalseObjects

    @classmethod
    def of_data_sheet(cls, sensor: SensorModel) -> Self:
        """Return the state before the first scan."""
        return cls(sensor, Reach.of_data_sheet(sensor.range_m), FalseObjects.none())

    def with_clutter(self, false_detections: float, dt_s: float, memory_s: float | None) -> Self:
        """Return it with a scan's expected number of false detections added; None keeps the data sheet's number."""
        if memory_s is None:
            return self
        known, share = self.sensor.clutter_per_scan, -np.expm1(-dt_s / memory_s)
        counted = known + share * (false_detections - known)
        return replace(self, sensor=replace(self.sensor, clutter_per_scan=float(counted)))


def with_sources(learned: FalseObjects, sources: Sources, removed: BoolArray) -> FalseObjects:
    """Return it with the present and the removed sources counted, shape (m,)."""
    alive = sources.existence[:, None, None, None] * sources.kinds
    learned = learned.with_vehicles(alive, sources.hits, sources.born_in_view, np.exp(sources.stood_log), removed)
    gone = np.flatnonzero(removed & (sources.hits >= FEWEST_FALSE_HITS))
    lived_s = np.maximum(sources.age_s[gone] - sources.unseen_s[gone], 0.0)
    return learned.with_removed(alive[gone], sources.ended[gone], lived_s)
