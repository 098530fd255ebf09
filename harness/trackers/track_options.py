"""Settings that all Kalman trackers share: motion, birth and reporting of tracks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, TypeVar

from pydantic import Field

from harness.trackers.doubtful import DoubtfulOptions, as_reported
from harness.trackers.plane import is_in_plane
from harness.trackers.protocol import Tracker, TrackerFactory, TrackerSetting
from mmpf.options.base import Positive, Settings, in_unit


class TrackOptions(Settings):
    """Settings of a tracker of Kalman filters."""

    lon_noise: Annotated[Positive, in_unit("m²/s³")] = 1.0
    """Power spectral density of the longitudinal acceleration."""
    lat_noise: Annotated[Positive, in_unit("m²/s³")] = 0.1
    """Power spectral density of the lateral acceleration."""
    noise_factor: Annotated[Positive, in_unit("reported deviation")] = 1.0
    """Standard deviation of the measurement noise relative to the reported one; above 1 where errors are correlated in
    time.
    """
    gate_std: Positive = 3.9
    """A detection counts for a track within this many standard deviations."""
    confirm_detections: Annotated[int, Field(ge=1)] = 3
    """Detections before a track is confirmed."""
    held_unseen_s: Positive = 0.35
    """An unconfirmed track without detections for longer ends."""
    birth_speed_std_mps: Positive = 10.0
    """Spread of a new track's speed around the ego's, where speed is not measured."""
    birth_lat_speed_std_mps: Positive = 1.0
    """Spread of a new track's lateral speed."""
    hidden_after_s: Positive = 0.5
    """A track without detections for longer is reported as hidden; only pictures use this."""
    doubtful: DoubtfulOptions = DoubtfulOptions()
    """When a track that stands amid moving traffic is reported as tentative only."""


_Options = TypeVar("_Options", bound=TrackOptions)


def in_frame(kind: type[_Options], setting: TrackerSetting, options: Mapping[str, object]) -> _Options:
    """Return a tracker's options; in the plane y is filtered as x, since roads lead anywhere."""
    chosen = kind.model_validate(dict(options))
    if not is_in_plane(setting):
        return chosen
    alike = {"lat_noise": chosen.lon_noise, "birth_lat_speed_std_mps": chosen.birth_speed_std_mps}
    return chosen.model_copy(update=alike)


def factory(kind: type[_Options], tracker: Callable[[_Options, TrackerSetting], Tracker]) -> TrackerFactory:
    """Return what builds a tracker of two coordinates from its options, as its road and its doubts need it."""

    def build(setting: TrackerSetting, options: Mapping[str, object]) -> Tracker:
        chosen = in_frame(kind, setting, options)
        return as_reported(tracker(chosen, setting), setting, chosen.doubtful)

    return build
