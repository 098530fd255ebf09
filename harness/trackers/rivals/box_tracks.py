"""The tracks of box trackers: a Kalman filter of each box's centre, size and heading.

A box's middle moves at a nearly constant velocity; its size and direction hardly change. Middle, size and direction
are filtered apart (the state of AB3DMOT, Weng, Wang, Held and Kitani, IROS 2020, without heights).
"""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from harness.trackers.kalman import (
    LAT,
    LAT_SPEED,
    LON,
    SPEED,
    GaussianStates,
    newborn,
    predict_constant_velocity,
    updated,
)
from harness.trackers.rivals.boxes import FlatBoxes, generalised_overlap
from harness.trackers.rivals.lives import Lives
from harness.trackers.track_options import RivalOptions
from mmpf.numerics.arrays import FloatArray, IntArray, taken, wrapped
from mmpf.options.base import Positive, in_unit
from mmpf.options.filter import Footprint
from mmpf.scan import Detections, EgoPose

# Boxes whose middles are farther apart are not compared: even two lorries of which one stands before the other.
_COMPARED_WITHIN_M = 25.0
_TURNING_MPS = 1.0
_UNKNOWN_HEADING_STD_RAD = 1.0

SIZE_NOISE_M2_PER_S, HEADING_NOISE_RAD2_PER_S = 0.01, 0.05
"""Power spectral densities of the changes of a box's size, and of its direction where directions are measured."""


class BoxOptions(RivalOptions):
    """Settings that trackers of boxes share."""

    least_overlap: Annotated[float, Field(ge=-1.0, lt=1.0), in_unit("overlap")] = -0.4
    """Smallest generalised overlap of a detection and its track, -1 to 1; boxes that just touch have about 0."""
    vehicle: Footprint = Footprint()
    """Size of a vehicle before it is measured."""
    longest_unseen_s: Positive = 3.0
    """A confirmed track without detections for longer ends; AB3DMOT's own value is 0.2 s."""


@dataclass(frozen=True)
class BoxTracks:
    """The boxes that are followed, n of them.

    Attributes:
        size_m: Mean lengths and widths, shape (n, 2).
        heading_rad: Mean directions, shape (n,).
    """

    lives: Lives
    states: GaussianStates
    size_m: FloatArray
    size_variance_m2: FloatArray
    heading_rad: FloatArray
    heading_variance: FloatArray

    @property
    def middle_m(self) -> FloatArray:
        """Mean middles, shape (n, 2)."""
        return self.states.mean[:, [LON, LAT]]


def none_begun(options: BoxOptions) -> BoxTracks:
    """Return the boxes of a tracker that has seen nothing."""
    none = np.zeros(0)
    detections = Detections(none, none, none, none, none, none)
    return begun(Lives.begun(1, 0, 0.0), detections, EgoPose(0.0, 0.0, 0.0, 0.0, 1.0, 1.0), options)


def begun(lives: Lives, detections: Detections, ego: EgoPose, options: BoxOptions) -> BoxTracks:
    """Return a new track at each detection."""
    count = len(detections)
    size_m, size_std_m = _measured_sizes(detections, options)
    headings = detections.headings
    heading = np.zeros(count) if headings is None else headings.heading_rad
    unknown = np.full(count, _UNKNOWN_HEADING_STD_RAD)
    return BoxTracks(
        lives,
        newborn(detections, np.arange(count), ego, options),
        size_m,
        size_std_m**2,
        heading.copy(),
        (unknown if headings is None else headings.std_rad) ** 2,
    )


def predicted(tracks: BoxTracks, interval_s: float, options: BoxOptions, in_plane: bool) -> BoxTracks:
    """Return the boxes after some time without a look at them; in the plane a box points anywhere."""
    states = predict_constant_velocity(tracks.states, interval_s, options.lon_noise, options.lat_noise)
    heading, variance = tracks.heading_rad, tracks.heading_variance + HEADING_NOISE_RAD2_PER_S * interval_s
    if in_plane:
        # Where no direction was ever measured, boxes point where they go.
        speed = np.hypot(states.mean[:, SPEED], states.mean[:, LAT_SPEED])
        moves = (speed > _TURNING_MPS) & (tracks.heading_variance >= _UNKNOWN_HEADING_STD_RAD**2)
        heading = np.where(moves, np.arctan2(states.mean[:, LAT_SPEED], states.mean[:, SPEED]), heading)
    return replace(
        tracks,
        states=states,
        size_variance_m2=tracks.size_variance_m2 + SIZE_NOISE_M2_PER_S * interval_s,
        heading_rad=heading,
        heading_variance=variance,
    )


def overlaps(tracks: BoxTracks, middle_m: FloatArray, detections: Detections, options: BoxOptions) -> FloatArray:
    """Return the generalised overlap of each box with each detection's, -1 to 1, shape (n, d); -1 of boxes far apart.

    Args:
        tracks: The boxes.
        middle_m: Where their middles are taken to be, shape (n, 2).
        detections: The detections, d of them.
        options: The size of a vehicle that is not measured.
    """
    away_m = np.hypot(detections.lon_m - middle_m[:, 0, None], detections.lat_m - middle_m[:, 1, None])
    track, detection = np.nonzero(away_m <= _COMPARED_WITHIN_M)
    size_m, heading = tracks.size_m[track], tracks.heading_rad[track]
    expected = FlatBoxes(middle_m[track, 0], middle_m[track, 1], size_m[:, 0], size_m[:, 1], heading)
    found_size = _measured_sizes(detections, options)[0][detection]
    found_heading = heading if detections.headings is None else detections.headings.heading_rad[detection]
    found = FlatBoxes(
        detections.lon_m[detection], detections.lat_m[detection], found_size[:, 0], found_size[:, 1], found_heading
    )
    overlap = np.full(away_m.shape, -1.0)
    overlap[track, detection] = generalised_overlap(expected, found)
    return overlap


def taken_in(
    tracks: BoxTracks, index: IntArray, detections: Detections, detection: IntArray, time_s: float
) -> BoxTracks:
    """Return the boxes after a detection each of some of them, at most one each.

    Args:
        tracks: The boxes before.
        index: Whose detections they are, shape (k,).
        detections: All detections.
        detection: Which of them, shape (k,).
        time_s: Now.
    """
    states = updated(tracks.states, index, detections, detection)
    size_m, size_variance = tracks.size_m.copy(), tracks.size_variance_m2.copy()
    heading, heading_variance = tracks.heading_rad.copy(), tracks.heading_variance.copy()
    if detections.sizes is not None:
        sizes = taken(detections.sizes, detection)
        measured = np.column_stack([sizes.length_m, sizes.width_m])
        noise = np.column_stack([sizes.std_length_m, sizes.std_width_m]) ** 2
        gain = size_variance[index] / (size_variance[index] + noise)
        size_m[index] += gain * (measured - size_m[index])
        size_variance[index] *= 1.0 - gain
    if detections.headings is not None:
        headings = taken(detections.headings, detection)
        off = wrapped(headings.heading_rad - heading[index])
        # A front taken for a back: what is measured then turns round (AB3DMOT's orientation correction).
        off = np.where(np.abs(off) > 0.5 * np.pi, wrapped(off + np.pi), off)
        gain = heading_variance[index] / (heading_variance[index] + headings.std_rad**2)
        heading[index] = wrapped(heading[index] + gain * off)
        heading_variance[index] *= 1.0 - gain
    return BoxTracks(tracks.lives.seen(index, time_s), states, size_m, size_variance, heading, heading_variance)


def _measured_sizes(detections: Detections, options: BoxOptions) -> tuple[FloatArray, FloatArray]:
    """Return lengths and widths of detections and their deviations, each of shape (d, 2)."""
    sizes, usual = detections.sizes, options.vehicle
    if sizes is None:
        ones = np.ones((len(detections), 1))
        return ones * [usual.length_m, usual.width_m], ones * [usual.std_length_m, usual.std_width_m]
    return (
        np.column_stack([sizes.length_m, sizes.width_m]),
        np.column_stack([sizes.std_length_m, sizes.std_width_m]),
    )
