"""The expected number of undetected vehicles on each lane piece, recorded twice a second."""

import numpy as np
import pandas as pd

from harness.running.recorder import when_of
from harness.scoring.evidence.rules import TIME_TOLERANCE_S
from harness.sensor.observation import Snapshot
from harness.trackers.protocol import AnyTracker, TellsUnseen
from harness.truth.frame import Frame
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.scan import Scan, SensorModel
from mmpf.tracks import Tracks
from mmpf.undetected.intensity import Unseen, UnseenTraffic
from mmpf.visibility.range_profile import Reach

EVERY_S = 0.5
PLACE_DECIMALS, EXPECTED_DECIMALS = 4, 6


class UnseenOfTracks:
    """Computes the expected number of undetected vehicles after each scan; a tracker's own statement takes precedence.

    What a tracker has learned of its sensor's reach, in an attribute ``reach``, takes the data sheet's place.
    """

    def __init__(self, road: Road, sensor: SensorModel) -> None:
        """Begin with the lanes and the data sheet as trackers believe them."""
        self._traffic = UnseenTraffic(road, sensor)

    def after(self, scan: Scan, tracks: Tracks, tracker: AnyTracker) -> Unseen:
        """Return what is expected after a scan, which a tracker has taken in."""
        if isinstance(tracker, TellsUnseen):
            return tracker.unseen
        reach = getattr(tracker, "reach", None)
        return self._traffic.step(scan, tracks, reach if isinstance(reach, Reach) else None)


class UnseenKeeper:
    """Collects, scan by scan, where unseen vehicles are to be expected, by stretches of lane."""

    def __init__(self, road: Road, sensor: SensorModel) -> None:
        """Begin with the lanes and the data sheet as trackers believe them."""
        self._road, self._sensor = road, sensor
        self._episode: int | None = None
        self._rows: list[pd.DataFrame] = []

    def watch(self, snapshot: Snapshot, tracks: Tracks, tracker: AnyTracker) -> None:
        """Look at one step."""
        if snapshot.frame.episode != self._episode:
            self._episode, self._next_s = snapshot.frame.episode, -np.inf
            self._unseen = UnseenOfTracks(self._road, self._sensor)
        unseen = self._unseen.after(snapshot.observation.scan, tracks, tracker)
        if snapshot.frame.time_s >= self._next_s:
            self._rows.append(by_stretch(snapshot.frame, unseen))
            self._next_s = snapshot.frame.time_s + EVERY_S - TIME_TOLERANCE_S

    def table(self) -> pd.DataFrame | None:
        """Return one row per moment and stretch, see ``by_stretch``; None before the first step."""
        return pd.concat(self._rows, ignore_index=True) if self._rows else None

    def forget(self) -> None:
        """Free the rows."""
        self._rows.clear()


def by_stretch(frame: Frame, unseen: Unseen) -> pd.DataFrame:
    """Return the stretches of lane that lie within range from end to end, as straight lines between their ends.

    Returns:
        The table ``unseen`` of ``harness.storage.schema``.
    """
    cells = unseen.cells
    _, first, cell = np.unique(cells.stretch, return_index=True, return_inverse=True)
    count = np.bincount(cell, minlength=len(first))
    whole = count == cells.in_stretch[first]

    def place(at: IntArray, share: float) -> tuple[FloatArray, FloatArray]:
        reach, heading = share * cells.length_m[at], cells.heading_rad[at]
        return cells.lon_m[at] + reach * np.cos(heading), cells.lat_m[at] + reach * np.sin(heading)

    from_lon, from_lat = place(first[whole], -0.5)
    to_lon, to_lat = place((first + count - 1)[whole], 0.5)
    places = {"from_lon_m": from_lon, "from_lat_m": from_lat, "to_lon_m": to_lon, "to_lat_m": to_lat}
    expected = np.bincount(cell, unseen.expected, minlength=len(first))[whole]
    return pd.DataFrame(
        {
            **{name: np.full(len(expected), value) for name, value in when_of(frame).items()},
            "stretch": cells.stretch[first][whole],
            **{name: np.round(values, PLACE_DECIMALS) for name, values in places.items()},
            "expected": np.round(expected, EXPECTED_DECIMALS),
        }
    )
