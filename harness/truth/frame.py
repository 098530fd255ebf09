"""A frame: the true state of every vehicle at one time; and the protocol of its sources."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mmpf.map.road import Road
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, StringArray
from mmpf.scan import EgoPose

STEP_S = 0.1
"""Time between the frames of every source, seconds."""

EVERYWHERE = (-np.inf, np.inf)
OPEN, CLOSED = "1", "0"


@dataclass(frozen=True)
class Frame:
    """All vehicles at one instant in the road frame, struct of arrays, each of shape (n,).

    Attributes:
        episode: Number of the ego's stay; a new ego begins a new episode.
        ego: Index of the ego vehicle in the arrays.
        vehicle_id: Name of each vehicle, as its source calls it.
        lon_m: Longitudinal position of the vehicle's centre.
        heading_rad: Heading against the road's direction, positive to the left.
        lat_speed_mps: Lateral speed, positive to the left.
        lane: Lane number as in ``mmpf.map.road``; 0 off the road.
        window_m: Stretch of the road of which the source knows all vehicles; beyond it nothing is scored.
        direction_rad: Direction against the longitudinal axis that errors of each vehicle are taken along. On a road
            whose frame is the plane (``Road.graph``) its heading; None elsewhere, where it is the road's own.
        parked: Whether each vehicle stands in one place for as long as it is on record; None where the source does not
            tell parked vehicles from others.
        pedestrian: Whether each is a person on foot, who hides others and is neither detected nor scored; None where
            the source knows of none.
        on_roundabout: Whether each vehicle is on a roundabout; None where none is known.
        signals: ``OPEN`` or ``CLOSED`` for each signal of the road's graph, one letter each, in the order of
            ``LinkControl.signal_name``; empty where there are none, or their states are not on record.
        vehicle_class: Code of the class of each, see ``mmpf.scan.VEHICLE_CLASSES``; None where the source tells none.
    """

    step: int
    time_s: float
    episode: int
    ego: int
    vehicle_id: StringArray
    lon_m: FloatArray
    lat_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray
    lat_speed_mps: FloatArray
    accel_mps2: FloatArray
    lane: IntArray
    length_m: FloatArray
    width_m: FloatArray
    window_m: tuple[float, float] = EVERYWHERE
    direction_rad: FloatArray | None = None
    parked: BoolArray | None = None
    pedestrian: BoolArray | None = None
    on_roundabout: BoolArray | None = None
    signals: str = ""
    vehicle_class: IntArray | None = None

    def __len__(self) -> int:
        return len(self.vehicle_id)

    @property
    def axis_rad(self) -> FloatArray:
        """Direction against the longitudinal axis along which each vehicle is measured, shape (n,)."""
        return np.zeros(len(self)) if self.direction_rad is None else self.direction_rad

    @property
    def ego_pose(self) -> EgoPose:
        """Pose of the ego vehicle."""
        names = ("lon_m", "lat_m", "heading_rad", "speed_mps", "length_m", "width_m")
        return EgoPose(**{name: float(getattr(self, name)[self.ego]) for name in names})


class TruthSource(Protocol):
    """Yields frames at a fixed step, at most ``expected_steps``; SUMO, a recorded run or recorded traffic."""

    road: Road
    step_s: float
    expected_steps: int

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order, warm-up left out. May be called once."""

    def close(self) -> None:
        """Release what the source holds; harmless to call twice."""


ROAD_OF_RECORDING = "recording"
