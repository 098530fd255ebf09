"""A baseline without memory: each scan's detections become its tracks, with new identities each time.

What a filter adds shows against it. Where speeds are not measured a detection is taken to be as fast as the ego.
"""

from collections.abc import Mapping

import numpy as np

from harness.trackers.protocol import TrackerSetting
from mmpf.options.base import Settings
from mmpf.scan import Scan, check_scan
from mmpf.tracks import CONFIRMED, Tracks

# Of a speed that is not measured.
_STD_SPEED_MPS = 10.0


class DetectionsOptions(Settings):
    """Settings of the baseline without memory: there are none."""


class DetectionsTracker:
    """Reports every detection as a vehicle, false ones too, and forgets it by the next scan."""

    def __init__(self) -> None:
        self._time_s: float | None = None
        self._next_track_id = 1

    def step(self, scan: Scan) -> Tracks:
        """Take in one scan and return its detections as tracks.

        Raises:
            InvalidScanError: See ``mmpf.scan.check_scan``.
        """
        check_scan(scan, self._time_s)
        self._time_s = scan.time_s
        found, count = scan.detections, len(scan.detections)
        measured = np.isfinite(found.speed_mps)
        self._next_track_id += count
        return Tracks(
            track_id=self._next_track_id - count + np.arange(count),
            lon_m=found.lon_m.copy(),
            lat_m=found.lat_m.copy(),
            speed_mps=np.where(measured, found.speed_mps, scan.ego.speed_mps),
            lat_speed_mps=np.zeros(count),
            accel_mps2=np.zeros(count),
            std_lon_m=found.std_lon_m.copy(),
            std_lat_m=found.std_lat_m.copy(),
            std_speed_mps=np.where(measured, found.std_speed_mps, _STD_SPEED_MPS),
            existence=np.ones(count),
            state=np.full(count, CONFIRMED, dtype=np.int8),
        )


def build_detections(setting: TrackerSetting, options: Mapping[str, object]) -> DetectionsTracker:  # noqa: ARG001
    """Build the baseline; it needs nothing of the setting."""
    DetectionsOptions.model_validate(dict(options))
    return DetectionsTracker()
