"""The role of a tracker: scans in, tracks out."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from mmpf.map.road import Road
from mmpf.scan import Scan, SensorModel
from mmpf.tracks import Tracks
from mmpf.undetected.intensity import Unseen


@dataclass(frozen=True)
class TrackerSetting:
    """All that a tracker may know before the first scan.

    Attributes:
        road: The lanes.
        sensor: The sensor's data sheet.
        rng: The tracker's own stream of randomness.
        step_s: Nominal time between scans.
    """

    road: Road
    sensor: SensorModel
    rng: np.random.Generator
    step_s: float = 0.1


class Tracker(Protocol):
    """Follows the vehicles around the ego through one episode."""

    def step(self, scan: Scan) -> Tracks:
        """Take in one scan and return the tracks as they stand after it.

        Raises:
            InvalidScanError: The scan holds impossible values, or its time is not later than the last one's.
        """


@runtime_checkable
class TruthAssociatedTracker(Protocol):
    """A reference, not a tracker: it is given the true origin of each detection, and nothing else of the truth."""

    def step_associated(self, scan: Scan, truth_id: npt.NDArray[np.str_]) -> Tracks:
        """Take in one scan with the true origin of each detection (empty for clutter), shape (d,)."""


@runtime_checkable
class TellsUnseen(Protocol):
    """A tracker that says itself what it expects where it has no track; for others the harness works it out."""

    @property
    def unseen(self) -> Unseen:
        """What it expects after the last scan."""


AnyTracker = Tracker | TruthAssociatedTracker


def step_tracker(tracker: AnyTracker, scan: Scan, truth_id: npt.NDArray[np.str_]) -> Tracks:
    """Give a tracker one scan, and a reference the true origin of each detection with it, shape (d,)."""
    if isinstance(tracker, TruthAssociatedTracker):
        return tracker.step_associated(scan, truth_id)
    return tracker.step(scan)


class TrackerFactory(Protocol):
    """Builds a tracker for one episode from its setting and its own options."""

    def __call__(self, setting: TrackerSetting, options: Mapping[str, object]) -> AnyTracker:
        """Return a fresh tracker."""
