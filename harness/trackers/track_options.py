"""What all Kalman trackers share: settings of motion, birth and reporting of tracks, and how scans are prepared."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Annotated, Self, TypeVar

import numpy as np
from pydantic import Field

from harness.trackers.doubtful import DoubtfulOptions, DoubtingTracker
from harness.trackers.plane import along_their_motion, is_in_plane, without_directions
from harness.trackers.protocol import Tracker, TrackerFactory, TrackerSetting
from mmpf.numerics.arrays import taken
from mmpf.options.base import Positive, Probability, Settings, in_unit
from mmpf.scan import Scan, check_scan
from mmpf.tracks import Tracks


class KalmanOptions(Settings):
    """Settings of all Kalman filters."""

    lon_noise: Annotated[Positive, in_unit("m²/s³")] = 1.0
    """Power spectral density of the longitudinal acceleration."""
    lat_noise: Annotated[Positive, in_unit("m²/s³")] = 0.1
    """Power spectral density of the lateral acceleration."""
    confirm_detections: Annotated[int, Field(ge=1)] = 3
    """Detections before a track is confirmed."""
    birth_speed_std_mps: Positive = 10.0
    """Spread of a new track's speed around the ego's, where speed is not measured."""
    birth_lat_speed_std_mps: Positive = 1.0
    """Spread of a new track's lateral speed."""
    hidden_after_s: Positive = 0.5
    """A track without detections for longer is reported as hidden; only pictures use this."""

    def in_plane(self) -> Self:
        """Return the settings for the plane, where y is filtered as x, since roads lead anywhere."""
        alike = {"lat_noise": self.lon_noise, "birth_lat_speed_std_mps": self.birth_speed_std_mps}
        return self.model_copy(update=alike)


class TrackOptions(KalmanOptions):
    """Settings of a tracker of Kalman filters."""

    noise_factor: Annotated[Positive, in_unit("reported deviation")] = 1.0
    """Standard deviation of the measurement noise relative to the reported one; above 1 where errors are correlated in
    time.
    """
    gate_std: Positive = 3.9
    """A detection counts for a track within this many standard deviations."""
    held_unseen_s: Positive = 0.35
    """An unconfirmed track without detections for longer ends."""
    doubtful: DoubtfulOptions = DoubtfulOptions()
    """When a track that stands amid moving traffic is reported as tentative only."""


class RivalOptions(TrackOptions):
    """Settings of a tracker whose confirmed tracks end when they are lost."""

    longest_unseen_s: Positive = 5.0
    """A confirmed track without detections for longer ends."""


class ExistenceOptions(RivalOptions):
    """Settings of a filter that keeps an existence probability of each track."""

    detection_probability: Probability | None = None
    """Detection probability in plain view; None takes the sensor's."""
    clutter_factor: Positive = 1.0
    """Clutter density relative to the data sheet's."""
    stay_s: Positive = 60.0
    """Mean lifetime of a vehicle."""
    reported_existence: Probability = 0.5
    """Existence probability from which a track is reported."""
    least_existence: Annotated[float, Field(gt=0.0, lt=1.0)] = 1e-3
    """A track (in ``pmbm`` a hypothesis) with a lower existence probability ends. In ``pmbm`` one tenth of a new
    vehicle's probability is the largest limit.
    """


_Options = TypeVar("_Options", bound=TrackOptions)
_DEVIATIONS = ("std_lon_m", "std_lat_m", "std_speed_mps")


def factory(kind: type[_Options], make: Callable[[_Options, TrackerSetting], Tracker]) -> TrackerFactory:
    """Return what builds a tracker of two coordinates, which is given scans as ``_TwoCoordinates`` prepares them."""

    def build(setting: TrackerSetting, options: Mapping[str, object]) -> Tracker:
        chosen, in_plane = kind.model_validate(dict(options)), is_in_plane(setting)
        if in_plane:
            chosen = chosen.in_plane()
        tracker = _TwoCoordinates(make(chosen, setting), chosen.noise_factor, in_plane)
        return DoubtingTracker(tracker, chosen.doubtful, in_plane) if chosen.doubtful.on else tracker

    return build


class _TwoCoordinates:
    """A tracker that need not know the kind of road, nor check what it is given.

    Its detections are in an order of their own, so that that of the input means nothing. In the plane it is told no
    directions, and its speeds are those along its tracks' motion.
    """

    def __init__(self, tracker: Tracker, noise_factor: float, in_plane: bool) -> None:
        self._tracker, self._noise_factor, self._in_plane = tracker, noise_factor, in_plane
        self._time_s: float | None = None

    def step(self, scan: Scan) -> Tracks:
        """Take in one scan and return the tracks; see ``Tracker``."""
        check_scan(scan, self._time_s)
        self._time_s = scan.time_s
        found = taken(scan.detections, np.lexsort((scan.detections.lat_m, scan.detections.lon_m)))
        deviations = {name: self._noise_factor * getattr(found, name) for name in _DEVIATIONS}
        scan = replace(scan, detections=replace(found, **deviations))
        if self._in_plane:
            return along_their_motion(self._tracker.step(without_directions(scan)))
        return self._tracker.step(scan)
