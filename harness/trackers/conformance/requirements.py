"""The requirements that the tracker protocol sets for every step, checked while scans are processed."""

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Protocol

import numpy as np

from harness.trackers.conformance.scripted_scenes import LabelledScan
from harness.trackers.protocol import AnyTracker, step_tracker
from harness.trackers.wellformed import fault_of
from mmpf.numerics.arrays import FloatArray
from mmpf.scan import InvalidScanError
from mmpf.tracks import TENTATIVE, Tracks

Build = Callable[[int], AnyTracker]


class HasPlace(Protocol):
    """A car whose place is known at any time."""

    @property
    def name(self) -> str:
        """True identity."""

    def place_at(self, time_s: float) -> tuple[float, float]:
        """Return the longitudinal and lateral position at a time."""


class TrackerCheckError(AssertionError):
    """A tracker does not keep what the role promises; the message says what and when."""


def follow(build: Build, scans: Sequence[LabelledScan]) -> list[Tracks]:
    """Feed the scans to a fresh tracker and return its tracks, each required to be well formed.

    Raises:
        TrackerCheckError: A step raised, or its tracks are malformed.
    """
    tracker = build(0)
    return [step(tracker, labelled) for labelled in scans]


def step(tracker: AnyTracker, labelled: LabelledScan) -> Tracks:
    """Feed one scan and return the tracks, required to be well formed.

    Raises:
        TrackerCheckError: The step raised, or its tracks are malformed.
    """
    try:
        tracks = step_tracker(tracker, labelled.scan, labelled.truth_id)
    except Exception as error:
        raise TrackerCheckError(_at(f"step raised {type(error).__name__}: {error}", labelled)) from error
    _require_well_formed(tracks, labelled)
    return tracks


def require_refusal(tracker: AnyTracker, labelled: LabelledScan, what: str) -> None:
    """Feed a scan that no sensor can have made.

    Raises:
        TrackerCheckError: The tracker took it in, or raised anything but ``InvalidScanError``.
    """
    try:
        step_tracker(tracker, labelled.scan, labelled.truth_id)
    except InvalidScanError:
        return
    except Exception as error:
        message = f"{what} raised {type(error).__name__}, not InvalidScanError (call mmpf.scan.check_scan first)"
        raise TrackerCheckError(message) from error
    raise TrackerCheckError(f"{what} was taken in; it must raise InvalidScanError (call mmpf.scan.check_scan first)")


def nearest_position(tracks: Tracks, car: HasPlace, labelled: LabelledScan) -> FloatArray:
    """Return the longitudinal and lateral position of a car's ``nearest_track``, metres, shape (2,)."""
    nearest = nearest_track(tracks, car, labelled)
    return np.array([tracks.lon_m[nearest], tracks.lat_m[nearest]])


def nearest_track(tracks: Tracks, car: HasPlace, labelled: LabelledScan) -> int:
    """Return the index of the confirmed track nearest to a car.

    Raises:
        TrackerCheckError: None is within 3 m of it.
    """
    confirmed = np.flatnonzero(tracks.state != TENTATIVE)
    lon_m, lat_m = car.place_at(labelled.scan.time_s)
    distance_m = np.hypot(tracks.lon_m[confirmed] - lon_m, tracks.lat_m[confirmed] - lat_m)
    require(bool((distance_m < 3.0).any()), f"no confirmed track within 3 m of car {car.name!r}", labelled)
    return int(confirmed[np.argmin(distance_m)])


def require(holds: bool, message: str, labelled: LabelledScan | None = None) -> None:
    """Require that something holds.

    Args:
        holds: Whether it does.
        message: What is wrong otherwise.
        labelled: The scan at which it is.

    Raises:
        TrackerCheckError: It does not hold.
    """
    if not holds:
        raise TrackerCheckError(message if labelled is None else _at(message, labelled))


def _require_well_formed(tracks: Tracks, labelled: LabelledScan) -> None:
    require((fault := fault_of(tracks)) is None, str(fault), labelled)
    for column in fields(Tracks):
        values = getattr(tracks, column.name)
        dtype = np.dtype({"track_id": np.int64, "state": np.int8}.get(column.name, np.float64))
        require(values.dtype == dtype, f"{column.name} is {values.dtype}, not {dtype}", labelled)
        require(bool(np.isfinite(values).all()), f"{column.name} holds a value that is not finite", labelled)


def _at(message: str, labelled: LabelledScan) -> str:
    return f"at {labelled.scan.time_s:g} s, {len(labelled.scan.detections)} detections: {message}"
