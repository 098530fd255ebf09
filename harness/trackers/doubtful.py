"""An option of all rivals: an object that stands still amid moving traffic gets a low existence.

False objects mostly stand, vehicles in flowing traffic mostly move. A track that stands while the traffic around it
flows is reported as tentative, unless it was seen to move before, has been followed for long, or lies in the ego's
path, where a withheld vehicle is a danger.
"""

from dataclasses import replace
from typing import Annotated

import numpy as np

from harness.trackers.protocol import Tracker
from mmpf.numerics.arrays import BoolArray, FloatArray, turned
from mmpf.options.base import NotNegative, Positive, Settings, in_unit
from mmpf.scan import EgoPose, Scan
from mmpf.tracks import TENTATIVE, Tracks

FLOW_WITHIN_M, LEAST_OTHERS = 100.0, 2
"""Tracks within this distance are nearby; with fewer of them the traffic is unknown and no track is doubtful."""
PATH_HALF_WIDTH_M, PATH_AHEAD_M = 1.8, 100.0
"""A track this near the ego's line, up to so far ahead, is in its path and never doubtful."""


class DoubtfulOptions(Settings):
    """When a track that stands amid moving traffic is reported as tentative only."""

    on: bool = False
    """Whether the rule is applied at all."""
    standing_mps: Positive = 2.0
    """A track stands if its speed may be below this."""
    standing_std: Annotated[NotNegative, in_unit("σ")] = 0.0  # noqa: RUF001
    """Number of standard deviations of uncertainty allowed in that test; with more, a new track must move for longer.
    """
    flow_mps: Positive = 5.0
    """Traffic flows if the median speed of other confirmed, not doubtful tracks nearby is above this."""
    moved_s: NotNegative = 1.0
    """A track whose speed was above ``standing_mps`` (by two standard deviations) for this total time is a vehicle and
    may stop.
    """
    trusted_after_s: Positive = 10.0
    """A track older than this is no longer doubtful."""


class DoubtingTracker:
    """A tracker whose standing tracks are tentative while the traffic around them flows."""

    def __init__(self, tracker: Tracker, options: DoubtfulOptions, in_plane: bool = False) -> None:
        """Wrap a tracker.

        Args:
            in_plane: Whether the road frame is the plane, where the ego's path leads along its heading; else it leads
                along the road.
        """
        self._tracker, self._options, self._in_plane = tracker, options, in_plane
        self._time_s: float | None = None
        self._first_s: dict[int, float] = {}
        self._moved_s: dict[int, float] = {}
        self._doubted: set[int] = set()

    def step(self, scan: Scan) -> Tracks:
        """Take in one scan and return the tracks; see ``Tracker``."""
        tracks = self._tracker.step(scan)
        interval_s = 0.0 if self._time_s is None else scan.time_s - self._time_s
        self._time_s = scan.time_s
        names, speed = tracks.track_id.tolist(), np.abs(tracks.speed_mps)
        surely_moves = speed - 2.0 * tracks.std_speed_mps > self._options.standing_mps
        self._first_s = {name: self._first_s.get(name, scan.time_s) for name in names}
        self._moved_s = {
            name: self._moved_s.get(name, 0.0) + (interval_s if moves else 0.0)
            for name, moves in zip(names, surely_moves.tolist(), strict=True)
        }
        doubtful = self._stands_amid_flow(tracks, speed) & ~self._is_trusted(names, scan.time_s)
        doubtful &= ~self._in_path(tracks, scan.ego)
        self._doubted = set(tracks.track_id[doubtful].tolist())
        return replace(tracks, state=np.where(doubtful, TENTATIVE, tracks.state).astype(np.int8))

    def _is_trusted(self, names: list[int], time_s: float) -> BoolArray:
        """Return which tracks have shown what they are, by moving or by staying, shape (m,)."""
        options = self._options
        moved_s = np.array([self._moved_s[name] for name in names])
        followed_s = time_s - np.array([self._first_s[name] for name in names])
        return np.asarray((moved_s > options.moved_s - 1e-6) & (moved_s > 0.0)) | (
            followed_s > options.trusted_after_s - 1e-6
        )

    def _stands_amid_flow(self, tracks: Tracks, speed: FloatArray) -> BoolArray:
        """Return which confirmed tracks stand while those nearby flow, shape (m,)."""
        options = self._options
        confirmed = tracks.state != TENTATIVE
        stands = confirmed & (speed - options.standing_std * tracks.std_speed_mps < options.standing_mps)
        doubted = np.array([name in self._doubted for name in tracks.track_id.tolist()], dtype=np.bool_)
        tells = np.flatnonzero(confirmed & ~doubted)
        flows = np.zeros(len(tracks), dtype=np.bool_)
        for k in np.flatnonzero(stands).tolist():
            away_m = np.hypot(tracks.lon_m[tells] - tracks.lon_m[k], tracks.lat_m[tells] - tracks.lat_m[k])
            nearby = speed[tells[(away_m <= FLOW_WITHIN_M) & (tells != k)]]
            flows[k] = len(nearby) >= LEAST_OTHERS and np.median(nearby) > options.flow_mps
        return flows

    def _in_path(self, tracks: Tracks, ego: EgoPose) -> BoolArray:
        """Return which tracks lie ahead of the ego near its line, shape (m,)."""
        turn = ego.heading_rad if self._in_plane else 0.0
        lon, lat = tracks.lon_m - ego.lon_m, tracks.lat_m - ego.lat_m
        ahead, aside = turned(lon, lat, turn)
        near = np.abs(aside) < PATH_HALF_WIDTH_M
        return np.asarray(near & (ahead > 0.0) & (ahead <= PATH_AHEAD_M))
