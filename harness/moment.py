"""Keeps the one moment of a run that is most worth a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from harness.cosim import AnyTracker
from harness.sensor.observation import Observation
from harness.truth.frame import Frame
from mmpf.road import FloatArray
from mmpf.state import HIDDEN, LAT, LON, Mixture, Tracks


@runtime_checkable
class ParticleFilter(Protocol):
    """A tracker that can show its particles."""

    @property
    def mixture(self) -> Mixture:
        """The belief after the last scan."""
        ...


@dataclass(frozen=True)
class Moment:
    """One instant of a run.

    Attributes:
        frame: The truth.
        observation: What the sensor made of it.
        tracks: The tracks after it.
        particles: Longitudinal and lateral position of every particle, shape (2, n); None where a tracker has none.
    """

    frame: Frame
    observation: Observation
    tracks: Tracks
    particles: FloatArray | None


@dataclass
class MomentKeeper:
    """Keeps the moment with the most hidden tracks on the road on record, the first of equals.

    Attributes:
        moment: The best moment so far; None before the first step.
    """

    moment: Moment | None = None
    _best: int = -1

    def watch(self, frame: Frame, observation: Observation, tracks: Tracks, tracker: AnyTracker) -> None:
        """Look at one step."""
        start_m, end_m = frame.window_m
        hidden = int(np.count_nonzero((tracks.state == HIDDEN) & (tracks.lon_m >= start_m) & (tracks.lon_m <= end_m)))
        if hidden <= self._best:
            return
        self._best = hidden
        particles = tracker.mixture.cloud.state[[LON, LAT]] if isinstance(tracker, ParticleFilter) else None
        self.moment = Moment(frame, observation, tracks, particles)
