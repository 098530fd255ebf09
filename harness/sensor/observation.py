"""What a sensor makes of a frame: the scan for the tracker, and facts for scoring alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from harness.truth.frame import Frame
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray, IntArray, StringArray, taken
from mmpf.scan import Scan, SensorModel


@dataclass(frozen=True)
class Observation:
    """The sensor's result for one frame.

    Attributes:
        truth_id: Vehicle that each detection came from, empty for clutter, shape (d,). For scoring only.
        detection_visible_fraction: Visible fraction of that vehicle, nan for clutter, shape (d,). For scoring only.
        visible_fraction: Visible fraction of each vehicle of the frame, shape (n,); 1 for the ego.
        in_range: Whether each vehicle's centre lies within the sensor's range, shape (n,).
        state: ``VISIBLE``, ``PARTIAL``, ``HIDDEN`` or ``OUT`` of range for each vehicle, shape (n,).
        behind_walls: Share of each vehicle that walls hide, in [0, 1], shape (n,); None on a road without walls.
        pseudo_hidden_s: Length of the time for which each vehicle is hidden on purpose, 0 where it is not, shape (n,);
            None where no vehicle ever is.
    """

    scan: Scan
    truth_id: StringArray
    detection_visible_fraction: FloatArray
    visible_fraction: FloatArray
    occluder: IntArray
    in_range: npt.NDArray[np.bool_]
    state: npt.NDArray[np.int8]
    behind_walls: FloatArray | None = None
    pseudo_hidden_s: FloatArray | None = None

    def with_detections(self, index: IntArray) -> Observation:
        """Return the observation with some of its detections, shape (k,), and nothing else changed."""
        if len(index) == len(self.truth_id):
            return self
        return replace(
            self,
            scan=replace(self.scan, detections=taken(self.scan.detections, index)),
            truth_id=self.truth_id[index],
            detection_visible_fraction=self.detection_visible_fraction[index],
        )


@dataclass(frozen=True)
class Snapshot:
    """What the sensor saw at one moment, with the truth beside it, and the wall times that both took."""

    frame: Frame
    observation: Observation
    truth_s: float = 0.0
    sensor_s: float = 0.0


class Sensor(Protocol):
    """Turns frames into observations."""

    def model(self, road: Road | None = None) -> SensorModel:
        """Return what a tracker may know of this sensor on a road before the first scan."""

    def observe(self, frame: Frame, road: Road, rng: np.random.Generator) -> Observation:
        """Look at the frame from its ego vehicle.

        Args:
            road: Maps the frame's road coordinates to the plane in which light travels straight.

        Returns:
            The observation; detections are in an order that tells nothing of the vehicles.
        """
